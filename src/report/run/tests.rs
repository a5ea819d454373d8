use super::*;

/// A made-up engagement: search, hand-over, precise track, dwell until the skin fails.
fn demonstration() -> ReportData {
    // A fixed pseudo-random sequence in [-1, 1).
    let mut bits = 1_u64;
    let mut noise = move || {
        bits = bits
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (bits >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
    };
    let mut data = ReportData {
        title: "Rooftop engagement of one quadrotor at 1 km".into(),
        scenario: "urban-1km".into(),
        version: "0.1.0".into(),
        seed: 42,
        state_hash: "5d1c8f0e77ab3924".into(),
        outcome: "Neutralised: the skin of uav-1 failed after 6.2 s of dwell".into(),
        succeeded: true,
        ..ReportData::default()
    };
    let mut station = StationReport {
        name: "roof".into(),
        failure_temperature_k: Some(933.0),
        ..StationReport::default()
    };
    let sure = (0..20).map(|t_s| (f64::from(t_s), 0.2 * f64::from(t_s)));
    station.belief = vec![("looks", sure.collect())];
    data.summary = [
        ("Simulated time", "20.0 s"),
        ("Real-time factor", "118"),
        ("Time to acquire", "2.417 s"),
        ("Time to neutralise", "14.583 s"),
        ("Dwell", "6.208 s"),
        ("Energy", "18.6 kJ"),
        ("Peak irradiance", "2.31 MW/m\u{b2}"),
        ("Share of rendering", "61 %"),
    ]
    .map(|(label, value)| (label.to_owned(), value.to_owned()))
    .into();
    let mut skin_k = 288.0;
    for i in 0..19_200 {
        let t = f64::from(i) / 960.0;
        let firing = (8.375..14.583).contains(&t);
        let scintillation = (0.35 * noise()).exp();
        let power_w = if firing {
            1850.0 * (0.9 + 0.1 * scintillation)
        } else {
            0.0
        };
        station.power_in_bucket_w.push((t, power_w));
        station
            .irradiance_wpm2
            .push((t, power_w * 1000.0 * scintillation));
        skin_k += (power_w * 0.075 - (skin_k - 288.0) * 0.04) / 960.0;
        station.skin_temperature_k.push((t, skin_k));
        let seen = t > 2.417 && !(6.0..6.4).contains(&t);
        let settle = 400.0 * (-(t - 2.4) * 1.6).exp();
        let los = if seen {
            (settle + 6.0 + 3.0 * noise()).abs()
        } else {
            f64::NAN
        };
        station.los_error_urad.push((t, los));
        if i % 16 == 0 {
            let miss = if seen {
                los / 18.0 + 1.5 + noise()
            } else {
                f64::NAN
            };
            station.miss_coarse_px.push((t, miss));
        }
        if i % 8 == 0 && t > 4.0 {
            let miss = if seen {
                (los / 27.0 + 0.4 + 0.3 * noise()).abs()
            } else {
                f64::NAN
            };
            station.miss_precise_px.push((t, miss));
        }
    }
    station.states = [
        (0.0, 2.417, "search", "start of the run"),
        (2.417, 4.0, "coarse track", "3 of 4 frames confirm uav-1"),
        (
            4.0,
            6.0,
            "precise track",
            "target within the precise field of view",
        ),
        (6.0, 6.4, "coast", "no detection: occluded by a facade"),
        (
            6.4,
            8.375,
            "precise track",
            "detection gated at 2.1 \u{3c3}",
        ),
        (
            8.375,
            14.583,
            "engage",
            "interlocks clear & error < 15 \u{b5}rad",
        ),
        (14.583, 20.0, "assess", "skin temperature reached 933 K"),
    ]
    .map(|(t0_s, t1_s, name, reason)| StateSpan {
        t0_s,
        t1_s,
        name: name.into(),
        reason: reason.into(),
    })
    .into();
    for (i, camera) in ["stv", "ctv", "ctv", "ptv", "ptv", "ptv"]
        .into_iter()
        .enumerate()
    {
        let (w, h) = (640_usize, 480_usize);
        let (cx, cy) = (150.0 + 55.0 * i as f64, 170.0 + 22.0 * i as f64);
        let half = 3.0 + 5.0 * i as f64;
        let mut rgb8 = Vec::with_capacity(w * h * 3);
        for y in 0..h {
            for x in 0..w {
                let roof = 330 + (x / 70 * 37 % 90);
                let dark = (x as f64 - cx).abs() < half && (y as f64 - cy).abs() < half * 0.4;
                let grey = match (dark, y > roof) {
                    (true, _) => 40.0,
                    (false, true) => 95.0 + (x / 70 * 13 % 40) as f64,
                    (false, false) => 215.0 - 0.12 * y as f64,
                } + 4.0 * noise();
                rgb8.extend([grey * 0.95, grey, (grey * 1.06).min(255.0)].map(|v| v as u8));
            }
        }
        data.frames.push(ContactFrame {
            camera: camera.into(),
            time_s: 2.417 + 2.4 * i as f64,
            width: 640,
            height: 480,
            rgb8,
            boxes: vec![ContactBox {
                label: format!("uav-1 0.{}", 81 + 3 * i),
                rect_px: [cx - half, cy - half * 0.4, cx + half, cy + half * 0.4],
                colour: [230, 159, 0],
            }],
            reticle_px: [320.0, 240.0],
            caption: station.states[i.min(5)].name.clone(),
        });
    }
    data.stations.push(station);
    data
}

#[test]
fn report_is_one_small_safe_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("report.html");
    let mut data = demonstration();
    data.outcome.push_str("<script>alert('&')</script>");
    data.frames[0].boxes[0].label = "\"><b>".into();
    write_report(&path, &data).unwrap();
    let page = std::fs::read_to_string(&path).unwrap();
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    assert!(!page.contains("<script") && !page.contains("\"><b>"));
    assert!(page.contains("&lt;script&gt;alert('&amp;')&lt;/script&gt;"));
    // Nothing is loaded from elsewhere.
    assert!(!page.contains("http") && !page.contains("url(") && !page.contains("@import"));
    assert_eq!(
        page.matches("href=\"data:image/jpeg;base64,").count(),
        data.frames.len()
    );
    assert!(page.contains("What speaks for a UAV"));
    // All six series but the belief are dense, so have their extremes and their means.
    assert_eq!(page.matches("<path class=\"s faint\"").count(), 6);
    assert_eq!(page.matches("<path class=\"s\"").count(), 7);
    assert!(!page.contains(">NaN") && !page.contains("NaN "));
}

#[test]
fn empty_data_gives_a_page_that_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("report.html");
    let mut data = ReportData {
        stations: vec![StationReport::default()],
        ..ReportData::default()
    };
    write_report(&path, &data).unwrap();
    let page = std::fs::read_to_string(&path).unwrap();
    assert_eq!(page.matches("no samples").count(), 8);
    assert!(page.contains("no states") && page.contains("no images"));
    assert!(page.contains(">Miss distance<"));

    // Of several stations each has its own part.
    data.stations = ["north", "south"]
        .map(|name| StationReport {
            name: name.into(),
            ..StationReport::default()
        })
        .into();
    write_report(&path, &data).unwrap();
    let page = std::fs::read_to_string(&path).unwrap();
    assert_eq!(page.matches("no states").count(), 2);
    assert!(page.contains(">north: Miss distance<") && page.contains(">south: States<"));
}

#[test]
fn large_sheets_are_shrunk_to_fit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("report.html");
    let mut data = demonstration();
    // Noise hardly compresses.
    let mut bits = 1_u32;
    for byte in &mut data.frames[0].rgb8 {
        bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *byte = (bits >> 24) as u8;
    }
    data.frames = vec![data.frames[0].clone(); 24];
    write_report(&path, &data).unwrap();
    let page = std::fs::read_to_string(&path).unwrap();
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    let shown = page.matches("data:image/jpeg").count();
    assert!(shown > 0);
    assert!(page.contains(&format!("{} later images left out", 24 - shown)));
}

#[test]
fn failures_are_typed() {
    let mut data = demonstration();
    data.frames.truncate(2);
    let nowhere = Path::new("/nonexistent/report.html");
    assert!(matches!(
        write_report(nowhere, &data),
        Err(ReportError::Output(_))
    ));
    data.frames[1].rgb8.pop();
    assert!(matches!(
        write_report(nowhere, &data),
        Err(ReportError::Frame { index: 1, .. })
    ));
}
