//! Rendered pictures against the truth.

use crate::common::{ROOT, rendering, scenario};
use bevy::light::cluster::GlobalClusterSettings;
use boresight::app::{self, Options};
use boresight::components::capture::Tier;
use boresight::components::capture::{
    ExposedFrame, Frames, PixelRect, RenderedTruth, SensorCamera, UavInFrame,
};
use boresight::components::environment::Environment;
use boresight::components::flight::UavShape;
use boresight::components::flight::{Flight, Uav};
use boresight::models::air::sky::CHANNELS_M;
use boresight::models::bodies::Rotors;
use boresight::models::bodies::raster;
use boresight::models::ground::city::City;
use boresight::models::ground::dsm::{Dsm, LineOfSight};
use boresight::models::optics::camera::Pinhole;
use boresight::scenario::{Loaded, Scenario};
use glam::{DVec2, DVec3};
use std::path::Path;
use std::sync::Arc;

/// `urban_intercept` with the truth as detector, a search camera that stares, one UAV that hovers, and what else is set.
fn hovering_at(r_enu_m: DVec3, set: &[&str]) -> Loaded {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let [e, n, u] = r_enu_m.to_array();
    let own = [
        "detector.kind=truth".to_string(),
        // Still tracked: a target that falls changes shape.
        "engage.authorised=false".to_string(),
        "search.pattern=stare".to_string(),
        "search.cue={ kind = 'truth', sigma_deg = 0.001 }".to_string(),
        format!("uavs.0.trajectory={{ kind = \"hover\", position_enu_m = [{e}, {n}, {u}] }}"),
    ];
    let overrides: Vec<String> = (own.into_iter())
        .chain(set.iter().map(|text| (*text).to_owned()))
        .collect();
    Scenario::load(&path, &overrides).unwrap()
}

/// A frame, the UAV in it by projection and by its rendered identity, and by a silhouette of
/// 16 x 4 samples across a pixel.
struct Seen {
    frame: Arc<ExposedFrame>,
    geometric: UavInFrame,
    rendered: RenderedTruth,
    fine_box_px: [f64; 4],
    fine_centroid_px: DVec2,
}

/// A frame with each thing whose projection meets what was read out.
fn within(frame: &Arc<ExposedFrame>) -> Vec<(&Arc<ExposedFrame>, &UavInFrame)> {
    let PixelRect { offset_px, size_px } = frame.rect;
    let meets = |seen: &&UavInFrame| {
        (0..2).all(|i| {
            let (low, size) = (f64::from(offset_px[i]), f64::from(size_px[i]));
            seen.box_px[i + 2] > low && seen.box_px[i] < low + size
        })
    };
    let seen = frame.truth.iter().filter(meets);
    seen.map(|seen| (frame, seen)).collect()
}

/// Renders `seconds` of a scenario and takes every frame for each that is in it.
fn rendered(loaded: &Loaded, seconds: f64) -> Vec<Seen> {
    const FINER: u32 = 16;
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let mut app = app::build(loaded, &options).unwrap();
    let world = app.world_mut();
    // It shows in no picture, but doubles a window's time: lamps sorted into clusters on the GPU.
    let clusters = world.resource::<GlobalClusterSettings>();
    assert!(clusters.gpu_clustering.is_none());
    let mut uavs = world.query::<(&Uav, &Flight, &UavShape)>();
    let mut cameras = world.query::<&SensorCamera>();
    let mut seen = Vec::new();
    for _ in 0..(seconds * f64::from(loaded.scenario.tick_hz)) as u64 {
        app::step(world).unwrap();
        let frames = world.resource::<Frames>().0.clone();
        for (frame, geometric) in frames.iter().flat_map(within) {
            let (_, flight, shape) = uavs
                .iter(world)
                .find(|(uav, ..)| uav.index == geometric.uav)
                .unwrap();
            let camera = cameras
                .iter(world)
                .find(|camera| camera.tier == frame.tier)
                .unwrap();
            let finer = |n: u32| FINER * n;
            let state = &flight.state;
            let fine = raster::sampled_silhouette(
                &Pinhole {
                    width_px: finer(camera.pinhole.width_px),
                    height_px: finer(camera.pinhole.height_px),
                    focal_px: f64::from(FINER) * camera.pinhole.focal_px,
                },
                &frame.pose,
                (state.r_enu_m, state.q_enu_body),
                Rotors::of(state, camera.sensor.smeared_s(&frame.conditions.exposure)),
                &shape.mesh,
                PixelRect {
                    offset_px: frame.rect.offset_px.map(finer),
                    size_px: frame.rect.size_px.map(finer),
                },
                4,
            )
            .coverage();
            let coarser = |x: f64| x / f64::from(FINER);
            seen.push(Seen {
                frame: frame.clone(),
                geometric: geometric.clone(),
                rendered: geometric.rendered.unwrap(),
                fine_box_px: fine.box_px().unwrap().map(coarser),
                fine_centroid_px: DVec2::from(fine.centroid_px().unwrap().map(coarser)),
            });
        }
    }
    seen
}

/// Centroid of what stands out from the sky around a UAV in the 8-bit picture [px]; `None` where
/// the picture does not hold its surroundings.
fn picture_centroid_px(seen: &Seen) -> Option<DVec2> {
    const MARGIN_PX: f64 = 3.0;
    let rgb8 = seen.frame.rgb8.as_ref().unwrap();
    let [left, top] = seen.frame.rect.offset_px;
    let [width, height] = seen.frame.rect.size_px;
    let [x0, y0, x1, y1] = seen.fine_box_px;
    let (x0, y0) = (
        (x0 - MARGIN_PX).floor() as i64,
        (y0 - MARGIN_PX).floor() as i64,
    );
    let (x1, y1) = (
        (x1 + MARGIN_PX).ceil() as i64,
        (y1 + MARGIN_PX).ceil() as i64,
    );
    let inside = x0 > i64::from(left)
        && y0 > i64::from(top)
        && x1 < i64::from(left + width)
        && y1 < i64::from(top + height);
    if !inside {
        return None;
    }
    let at = |x: i64, y: i64| {
        let index = (y - i64::from(top)) * i64::from(width) + x - i64::from(left);
        let pixel = &rgb8[3 * index as usize..][..3];
        pixel.iter().map(|value| f64::from(*value)).sum::<f64>() / 3.0
    };
    let border: Vec<f64> = (x0..x1)
        .flat_map(|x| [at(x, y0), at(x, y1 - 1)])
        .chain((y0..y1).flat_map(|y| [at(x0, y), at(x1 - 1, y)]))
        .collect();
    let sky = border.iter().sum::<f64>() / border.len() as f64;
    let noise =
        (border.iter().map(|v| (v - sky).powi(2)).sum::<f64>() / border.len() as f64).sqrt();
    let (mut weight, mut sum) = (0.0, DVec2::ZERO);
    for (x, y) in (x0..x1).flat_map(|x| (y0..y1).map(move |y| (x, y))) {
        let contrast = (at(x, y) - sky).abs() - 3.0 * noise;
        if contrast > 0.0 {
            weight += contrast;
            sum += contrast * DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        }
    }
    (weight > 0.0).then(|| sum / weight)
}

#[test]
fn a_rendered_uav_is_where_the_truth_has_it() {
    let _one = rendering();
    let all = rendered(&hovering_at(DVec3::new(-660.0, 660.0, 125.0), &[]), 1.2);
    let (mut small, mut worst_px, mut sum) = (0, 0.0f64, DVec2::ZERO);
    let mut pictures_px = Vec::new();
    for seen in &all {
        let truth = &seen.rendered;
        assert!(truth.visible_fraction > 0.9, "{}", truth.visible_fraction);
        let (id, fine) = (truth.box_px.unwrap(), seen.fine_box_px);
        let projected = seen.geometric.box_px;
        for edge in 0..4 {
            // No identity outside the projection, to the pixel that an edge falls in.
            let outward = if edge < 2 {
                projected[edge] - id[edge]
            } else {
                id[edge] - projected[edge]
            };
            assert!(outward < 1.0 + 1e-6, "{id:?} leaves {projected:?}");
            // Samples may all miss a thin part, such as the smeared tip of a blade.
            let slack_px = 2.0 + 0.05 * (fine[2] - fine[0]);
            assert!(
                (id[edge] - fine[edge]).abs() < slack_px,
                "{id:?} against {fine:?}"
            );
        }
        let error = DVec2::from(truth.centroid_px.unwrap()) - seen.fine_centroid_px;
        let span_px = (fine[2] - fine[0]).max(fine[3] - fine[1]);
        if (2.0..4.0).contains(&span_px) {
            small += 1;
            worst_px = worst_px.max(error.length());
            sum += error;
            pictures_px.extend(picture_centroid_px(seen).map(|px| px - seen.fine_centroid_px));
        }
        println!(
            "{} {span_px:.2} px: {:+.3} {:+.3}",
            seen.frame.tier.name(),
            error.x,
            error.y
        );
    }
    let bias = sum / f64::from(small);
    println!("{small} frames of a 3 px target: worst {worst_px:.3} px, mean {bias:.3}");
    assert!(small >= 10, "{small} of {} frames", all.len());
    assert!(worst_px < 0.1, "{worst_px}");
    assert!(bias.length() < 0.05, "{bias}");
    // The picture shows the UAV there too. Its parts are not equally bright, and noise, blur and
    // eight bits come on top: a third of a pixel in the mean tells a shifted picture from a right one.
    let shift_px = pictures_px.iter().sum::<DVec2>() / pictures_px.len() as f64;
    println!(
        "{} pictures: shifted by {shift_px:.3} px",
        pictures_px.len()
    );
    assert!(pictures_px.len() >= 10, "{} pictures", pictures_px.len());
    assert!(shift_px.length() < 0.33, "{shift_px}");
}

#[test]
fn whatever_is_small_is_magnified() {
    let _one = rendering();
    // Some 25 px from the UAV in the search camera.
    let gull = "distractors=[{ name = 'gull', kind = 'bird', trajectory = { kind = 'hover', \
                position_enu_m = [-652, 668, 125], heading_deg = 30 } }]";
    let all = rendered(&hovering_at(DVec3::new(-660.0, 660.0, 125.0), &[gull]), 0.6);
    let (mut birds, mut worst_px) = (0, 0.0f64);
    let small = |seen: &&Seen| {
        let [x0, y0, x1, y1] = seen.fine_box_px;
        (1.5..4.0).contains(&(x1 - x0).max(y1 - y0))
    };
    for seen in all.iter().filter(small) {
        birds += u32::from(seen.geometric.distractor);
        let found_px = DVec2::from(seen.rendered.centroid_px.unwrap());
        worst_px = worst_px.max(found_px.distance(seen.fine_centroid_px));
    }
    println!("{birds} frames of the bird: worst {worst_px:.3} px");
    assert!(birds >= 5 && worst_px < 0.1, "{birds}, {worst_px} px");
}

#[test]
fn a_rendered_bird_is_where_the_truth_has_it() {
    let _one = rendering();
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let overrides = [
        "detector.kind=truth",
        "detector.truth.distractor_rate=1",
        // Taken for a UAV, so that every camera turns to it.
        "tracker.min_score=0",
        "engage.authorised=false",
        "station.position_enu_m=[0, 0, 48]",
        "search.pattern=stare",
        "uavs=[]",
        "distractors=[{ name = 'gull', kind = 'bird', trajectory = { kind = 'hover', \
         position_enu_m = [-105.5, 105.5, 63.7], heading_deg = 30 } }]",
    ];
    let loaded = Scenario::load(&path, &overrides.map(String::from)).unwrap();
    let all = rendered(&loaded, 0.6);
    assert!(all.len() > 20, "{} frames", all.len());
    let mut heights_px = Vec::new();
    for seen in &all {
        assert!(seen.geometric.distractor);
        let truth = &seen.rendered;
        assert!(truth.visible_fraction > 0.9, "{}", truth.visible_fraction);
        let (id, projected) = (truth.box_px.unwrap(), seen.geometric.box_px);
        for edge in 0..4 {
            let outward = if edge < 2 {
                projected[edge] - id[edge]
            } else {
                id[edge] - projected[edge]
            };
            // A wing's chord is left out of the sweep that its tip goes through.
            assert!(outward < 1.5, "{id:?} leaves {projected:?}");
            assert!((id[edge] - seen.fine_box_px[edge]).abs() < 3.0);
        }
        if seen.frame.tier.name() == "stv" {
            heights_px.push(id[3] - id[1]);
        }
    }
    // The wings beat.
    let most = heights_px.iter().copied().fold(0.0, f64::max);
    let least = heights_px.iter().copied().fold(f64::MAX, f64::min);
    assert!(most > 1.5 * least, "{heights_px:?}");
}

/// A place behind a building of `urban_intercept`'s city, well below the line to its roof.
fn hidden_place(dsm: &Dsm, station_enu_m: DVec3, city: &City) -> DVec3 {
    let steps_m = [-2.0, 0.0, 2.0];
    let around: Vec<DVec3> = steps_m
        .iter()
        .flat_map(|e| steps_m.iter().map(move |n| DVec2::new(*e, *n)))
        .flat_map(|en| steps_m.iter().map(move |u| en.extend(*u)))
        .collect();
    let candidates = city.buildings.iter().flat_map(|building| {
        let outline = building.footprint_enu_m();
        let centre = outline.iter().sum::<DVec2>() / outline.len() as f64;
        let away = centre.normalize();
        let reach_m = outline
            .iter()
            .map(|p| (*p - centre).length())
            .fold(0.0, f64::max);
        let behind = centre + (reach_m + 6.0) * away;
        let ground_m = dsm.surface_m(behind.x, behind.y);
        [5.0, 10.0, 15.0].map(|height_m| behind.extend(ground_m + height_m))
    });
    candidates
        .filter(|r| (300.0..800.0).contains(&r.distance(station_enu_m)))
        .find(|r| {
            around.iter().map(|offset| *r + *offset).all(|p| {
                p.z > dsm.surface_m(p.x, p.y) + 1.0
                    && matches!(
                        dsm.line_of_sight(station_enu_m, p),
                        LineOfSight::BlockedAt(_)
                    )
            })
        })
        .expect("a city hides something")
}

#[test]
fn a_uav_above_closed_cloud_is_not_visible() {
    let _one = rendering();
    let mut loaded = hovering_at(DVec3::new(-660.0, 660.0, 125.0), &[]);
    loaded.scenario.weather.cloud_cover = Some(1.0);
    for (base_m, seen_there) in [(130.0, true), (120.0, false)] {
        loaded.scenario.weather.cloud_base_m = Some(base_m);
        let all = rendered(&loaded, 0.2);
        assert!(all.len() >= 5, "{} frames", all.len());
        for seen in &all {
            assert_eq!(seen.geometric.clear, seen_there, "{base_m} m");
            let fraction = seen.rendered.visible_fraction;
            assert!((fraction > 0.9) == seen_there && (fraction == 0.0) != seen_there);
        }
    }
}

#[test]
fn a_uav_behind_a_building_is_not_visible() {
    let _one = rendering();
    let scenario = hovering_at(DVec3::new(-660.0, 660.0, 125.0), &[]).scenario;
    let city = City::generate(&scenario.city).unwrap();
    let r_enu_m = hidden_place(&city.dsm, city.station_enu_m(), &city);
    let all = rendered(&hovering_at(r_enu_m, &[]), 0.2);
    assert!(all.len() >= 5, "{} frames", all.len());
    for seen in &all {
        assert!(!seen.geometric.clear);
        assert!(
            seen.rendered.visible_fraction < 0.2,
            "{}",
            seen.rendered.visible_fraction
        );
    }
}

/// Linear signal of an 8-bit code, the inverse of the sRGB curve (IEC 61966-2-1).
/// Sunlit clouds are several times as bright as the mean sky that has their light, too: the exposure knows them.
#[test]
fn sunlit_clouds_are_not_blown_out() {
    let set = [
        "weather.metar=ZZZZ 050657Z 31012G22KT 9999 BKN030 12/07 Q1012 NOSIG",
        "weather.cloud_texture=true",
        "time_utc=2025-07-05T06:57:00Z",
        "seed=8598617661694",
    ];
    let loaded = hovering_at(DVec3::new(-660.0, -220.0, 160.0), &set);
    let frames = rendered(&loaded, 0.5);
    let shares = frames.iter().map(|seen| {
        let rgb8 = seen.frame.rgb8.as_ref().unwrap();
        let white = |pixel: &&[u8]| pixel.iter().all(|level| *level >= 254);
        3.0 * rgb8.chunks_exact(3).filter(white).count() as f64 / rgb8.len() as f64
    });
    let most = shares.fold(0.0, f64::max);
    println!("{} frames, white {most:.3} at most", frames.len());
    assert!(frames.len() > 10 && most < 0.05, "{most}");
}

fn linear(code: u8) -> f64 {
    let code = f64::from(code) / 255.0;
    if code <= 0.040_45 {
        code / 12.92
    } else {
        ((code + 0.055) / 1.055).powf(2.4)
    }
}

/// Mean contrast of a UAV's silhouette against the sky around it in a picture, from what its
/// pixels lack of the sky's light: blur moves that, but loses none.
fn contrast(frame: &ExposedFrame, seen: &UavInFrame, silhouette_px2: f64) -> f64 {
    const MARGIN_PX: f64 = 6.0;
    let rgb8 = frame.rgb8.as_ref().unwrap();
    let width = frame.rect.size_px[0] as usize;
    let signal = |x: usize, y: usize| {
        let pixel = &rgb8[3 * (y * width + x)..][..3];
        pixel.iter().map(|code| linear(*code)).sum::<f64>() / 3.0
    };
    let [x0, y0, x1, y1] = seen.box_px;
    let low = [x0, y0].map(|px| (px - MARGIN_PX).floor() as usize);
    let high = [x1, y1].map(|px| (px + MARGIN_PX).ceil() as usize);
    let mut sky = Vec::new();
    let (mut sum, mut pixels) = (0.0, 0.0);
    for y in low[1]..high[1] {
        for x in low[0]..high[0] {
            let signal = signal(x, y);
            sum += signal;
            pixels += 1.0;
            if x < low[0] + 2 || x + 2 >= high[0] || y < low[1] + 2 || y + 2 >= high[1] {
                sky.push(signal);
            }
        }
    }
    let sky = sky.iter().sum::<f64>() / sky.len() as f64;
    (pixels * sky - sum) / (silhouette_px2 * sky)
}

/// Four dark UAVs of one kind stand before the horizon in fog, turned alike. Their contrast falls
/// with the range as the model of the air says (eq. 5), which the shader works out for itself.
#[test]
fn ordered_fog_is_seen_in_the_next_frame() {
    let _one = rendering();
    // What a camera sets once by the light of the start would tell the runs apart.
    let own = [
        "detector.kind=truth",
        "station.cameras.search.exposure_s=0.001",
        "station.cameras.search.white_balance=daylight",
    ];
    let pictures = |set: &[&str]| -> Vec<Vec<u8>> {
        let builder = scenario("urban_intercept", &[&own, set].concat());
        let mut run = builder.pictures(true).open().unwrap();
        let mut pictures = Vec::new();
        for _ in 0..run.view().tick_hz() / 10 {
            run.step(1).unwrap();
            let search = run.frames().filter(|frame| frame.tier() == Tier::Search);
            pictures.extend(search.filter_map(|frame| Some(frame.rgb8()?.to_vec())));
        }
        pictures
    };
    let clear = pictures(&["weather={}"]);
    let foggy = pictures(&["weather={ visibility_m = 500 }"]);
    // The first frame is due after 1/30 s, the order a tick before the second.
    let order = "operator=[{ t_s = 0.0656, weather = { visibility_m = 500 } }]";
    let ordered = pictures(&["weather={}", order]);
    assert_eq!(ordered.len(), 3);
    assert!(ordered[0] == clear[0] && clear[0] != foggy[0]);
    assert!(ordered[1] == foggy[1] && ordered[2] == foggy[2]);
}

#[test]
fn a_dark_uav_fades_in_fog_as_the_air_light_model_says() {
    const VISIBILITY_M: f64 = 500.0;
    let _one = rendering();
    let station = DVec3::new(0.0, 0.0, 48.0);
    // Range and azimuth: side by side in the search camera's field.
    let places = [
        (80.0, 313.0),
        (120.0, 314.6),
        (160.0, 315.9),
        (200.0, 317.1),
    ];
    let uavs = places.map(|(range_m, azimuth_deg): (f64, f64)| {
        // One degree up, where the sky is as bright as the air-light.
        let (up, level) = 1.0_f64.to_radians().sin_cos();
        let (east, north) = azimuth_deg.to_radians().sin_cos();
        let r = station + range_m * DVec3::new(level * east, level * north, up);
        format!(
            "{{ name = '{range_m}', model = 'matrice600', trajectory = {{ kind = 'hover', \
             heading_deg = {azimuth_deg}, position_enu_m = [{}, {}, {}] }} }}",
            r.x, r.y, r.z
        )
    });
    let set = [
        "detector.kind=truth".to_string(),
        // Nothing is found, so that the search camera goes on looking.
        "detector.truth={ miss_rate = 1, false_alarms_per_frame = 0 }".to_string(),
        "station.position_enu_m=[0, 0, 48]".to_string(),
        // An even sky: the contrast is summed against the mean of what lies around.
        "station.cameras.search={ vignetting_percent = 0, prnu_percent = 0, dsnu_e = 0 }"
            .to_string(),
        "search={ centre_azimuth_deg = 315, elevation_deg = 1, pattern = 'stare' }".to_string(),
        "city={ building_density = 0, max_trees = 0, relief_m = 0, river = false }".to_string(),
        format!("weather={{ visibility_m = {VISIBILITY_M}, wind_speed_mps = 0 }}"),
        format!("uavs=[{}]", uavs.join(", ")),
    ];
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let loaded = Scenario::load(&path, &set).unwrap();
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let mut app = app::build(&loaded, &options).unwrap();
    let world = app.world_mut();
    let mut flights = world.query::<(&Uav, &Flight, &UavShape)>();
    let mut cameras = world.query::<&SensorCamera>();
    let mut sums = [0.0; 4];
    let mut ranges_m = [0.0; 4];
    let mut frames = 0.0;
    for _ in 0..loaded.scenario.tick_hz / 2 {
        app::step(world).unwrap();
        let searches = |frame: &&Arc<ExposedFrame>| frame.tier == Tier::Search;
        let Some(frame) = world.resource::<Frames>().0.iter().find(searches).cloned() else {
            continue;
        };
        let camera = cameras
            .iter(world)
            .find(|camera| camera.tier == Tier::Search)
            .unwrap();
        let smeared_s = camera.sensor.smeared_s(&frame.conditions.exposure);
        let camera = (camera.pinhole, camera.antialias);
        assert_eq!(frame.truth.len(), 4);
        for (uav, flight, shape) in flights.iter(world) {
            let seen = &frame.truth[uav.index];
            assert!(seen.clear && seen.rendered.unwrap().visible_fraction > 0.9);
            let state = &flight.state;
            let samples = raster::sampled_silhouette(
                &camera.0,
                &frame.pose,
                (state.r_enu_m, state.q_enu_body),
                Rotors::of(state, smeared_s),
                &shape.mesh,
                frame.rect,
                camera.1,
            );
            let silhouette_px2 = samples.coverage().samples / f64::from(camera.1);
            sums[uav.index] += contrast(&frame, seen, silhouette_px2);
            ranges_m[uav.index] = state.r_enu_m.distance(frame.pose.r_enu_m);
        }
        frames += 1.0;
    }
    assert!(frames >= 10.0, "{frames} frames");
    let contrasts = sums.map(|sum| sum / frames);
    // What the air's model leaves of the contrast of something black before the sky, in green.
    let environment = world.resource::<Environment>();
    let towards = DVec3::new(-1.0, 1.0, 0.02).normalize();
    let beta_per_m = CHANNELS_M.map(|m| environment.weather.extinction_per_m(m));
    let kept = |range_m: f64| {
        let sky = &environment.backdrop.sky;
        let seen = sky.through_air([0.0; 3], towards, beta_per_m, range_m);
        1.0 - seen[1] / sky.airlight(towards)[1]
    };
    let own = std::array::from_fn::<_, 4, _>(|i| contrasts[i] / kept(ranges_m[i]));
    println!("{frames} frames, {ranges_m:.1?} m: {contrasts:.4?}, without the fog {own:.4?}");
    // Dark parts before the sky: they reflect a sixth of its light.
    assert!(own.iter().all(|own| (0.8..1.0).contains(own)), "{own:?}");
    for i in 1..4 {
        // Measured: 0.6 per cent at most, from noise, eight bits and edges.
        let error = own[i] / own[0] - 1.0;
        assert!(error.abs() < 0.02, "{} m: {error:+.4}", ranges_m[i]);
    }
}
