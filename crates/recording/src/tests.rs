use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::mem;
use std::num::NonZeroU32;
use std::path::Path;
use std::sync::Arc;

use foxglove::messages as fg;
use mcap::{MessageStream, Summary, WriteOptions, read::Options, write::NoSeek};
use prost::Message as _;
use prost_reflect::{DescriptorPool, Kind, MessageDescriptor};
use serde_json::Value;

use super::file::Mcap;
use super::read::{ReadError, Recorded};
use super::recorder::NS;
use super::sink::Sink;
use super::topics::channels;
use super::*;

const HZ: NonZeroU32 = NonZeroU32::new(960).unwrap(); // [Hz]
const EPOCH_NS: u64 = 1_750_000_000_000_000_000; // [ns]
const META: Meta = Meta {
    scenario_name: "test",
    scenario_toml: "name = \"test\"\n",
    overrides: &[],
    seed: 42,
    pictures: true,
    version: "0.1.0",
    epoch_unix_ns: EPOCH_NS,
    tick_hz: HZ,
    cameras: &["stv", "ctv", "ptv"],
    more_stations: &[],
    own_topics: &[],
};

/// Calls every method, at the rates of a real run, for `ticks` ticks.
fn drive(recorder: &mut Recorder, ticks: u64) -> Result<(), RecordingError> {
    let rgb8: Vec<u8> = (0..64 * 48 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let picture = Picture {
        rgb8: Arc::new(rgb8),
        size_px: [64, 48],
        quality: 85,
        most_bytes: usize::MAX,
    };
    recorder.location_fix(0, "enu", 48.137, 11.575, 519.0)?;
    for camera in 0..META.cameras.len() {
        let k = [500.0, 0.0, 32.0, 0.0, 500.0, 24.0, 0.0, 0.0, 1.0];
        recorder.camera_calibration(0, camera, 64, 48, k)?;
    }
    for tick in 0..ticks {
        let t_s = tick as f64 / 960.0;
        recorder.own(
            tick,
            &proto::Tick {
                tick,
                simulated_s: t_s,
                state_hash: tick.wrapping_mul(0x9e37_79b9),
            },
        )?;
        recorder.own(
            tick,
            &proto::UavState {
                name: "uav-1".to_owned(),
                r_enu_m: Some(proto::Vec3 {
                    x: 8.0 * t_s,
                    y: 900.0,
                    z: 60.0,
                }),
                v_enu_mps: Some(proto::Vec3 {
                    x: 8.0,
                    y: 0.0,
                    z: 0.0,
                }),
                q_enu_body: Some(proto::Quat {
                    x: 0.0,
                    y: 0.0,
                    z: 0.0,
                    w: 1.0,
                }),
                skin_temperature_k: 290.0 + t_s,
                status: "flying".to_owned(),
                face_temperature_k: 290.0 + t_s,
                ..Default::default()
            },
        )?;
        recorder.own(
            tick,
            &proto::MountState {
                azimuth_rad: 0.1 * t_s,
                ..Default::default()
            },
        )?;
        recorder.frame_transforms(
            tick,
            &[FrameTransform {
                parent: "enu",
                child: "ptv",
                translation_m: [0.0, 0.0, 12.0],
                rotation: [0.0, 0.0, 0.0, 1.0],
            }],
        )?;
        if tick % 16 == 0 {
            recorder.scene_update(
                tick,
                &[SceneEntity {
                    id: "beam",
                    frame: "enu",
                    lifetime_ticks: 1,
                    shapes: &[
                        SceneShape::Cube {
                            centre_m: [0.0, 900.0, 20.0],
                            rotation: [0.0, 0.0, 0.0, 1.0],
                            size_m: [20.0, 20.0, 40.0],
                            colour: [0.5, 0.5, 0.5, 1.0],
                        },
                        SceneShape::Sphere {
                            centre_m: [8.0 * t_s, 900.0, 60.0],
                            diameter_m: 0.35,
                            colour: [0.9, 0.6, 0.0, 1.0],
                        },
                        SceneShape::Line {
                            points_m: &[[0.0, 0.0, 12.0], [8.0 * t_s, 900.0, 60.0]],
                            width_m: 0.05,
                            colour: [0.8, 0.2, 0.0, 1.0],
                        },
                    ],
                }],
            )?;
            for camera in 0..META.cameras.len() {
                recorder.picture(tick, camera, picture.clone())?;
                let name = META.cameras[camera].to_owned();
                recorder.image_annotations(
                    tick,
                    tick.saturating_sub(8),
                    camera,
                    &[BoxAnnotation {
                        label: "uav-1",
                        rect_px: [20.0, 20.0, 30.0, 27.0],
                        score: 0.97,
                        weak: false,
                    }],
                    [32.0, 24.0],
                )?;
                let seen = proto::BoxPx {
                    x0_px: 20.0,
                    y0_px: 20.0,
                    x1_px: 30.0,
                    y1_px: 27.0,
                };
                recorder.own(
                    tick,
                    &proto::FrameTruth {
                        camera: name.clone(),
                        exposure_tick: tick,
                        uavs: vec![proto::UavTruth {
                            name: "uav-1".to_owned(),
                            r#box: Some(seen),
                            visible_fraction: 1.0,
                            range_m: 902.0,
                        }],
                    },
                )?;
                recorder.own(
                    tick,
                    &proto::Detections {
                        camera: name.clone(),
                        exposure_tick: tick,
                        available_tick: tick + 8,
                        threshold: 0.25,
                        detections: vec![proto::Detection {
                            r#box: Some(seen),
                            score: 0.97,
                            label: "multirotor".to_owned(),
                        }],
                    },
                )?;
                recorder.own(
                    tick,
                    &proto::MissDistance {
                        camera: name,
                        exposure_tick: tick,
                        miss_px: 0.6,
                    },
                )?;
            }
            recorder.own(
                tick,
                &proto::TrackState {
                    state: "track".to_owned(),
                    target: "uav-1".to_owned(),
                    los_covariance: vec![1e-10; 16],
                    quality: 0.9,
                    class: "quadcopter".to_owned(),
                    track: Some(0),
                    ..Default::default()
                },
            )?;
            recorder.own(
                tick,
                &proto::BeamState {
                    firing: false,
                    interlocks: vec!["no track".to_owned()],
                    ..Default::default()
                },
            )?;
        }
        if tick % 960 == 0 {
            recorder.log(tick, LogLevel::Info, "atp", "a second has passed")?;
        }
    }
    Ok(())
}

/// A building that stands askew.
fn record_city(recorder: &mut Recorder) {
    let half_rad = 0.5 * 0.3_f64;
    let building = SceneShape::Cube {
        centre_m: [100.0, 50.0, 10.0],
        rotation: [0.0, 0.0, half_rad.sin(), half_rad.cos()],
        size_m: [40.0, 20.0, 20.0],
        colour: [0.7, 0.7, 0.7, 1.0],
    };
    let city = SceneEntity {
        id: CITY,
        frame: "enu",
        lifetime_ticks: 0,
        shapes: &[building],
    };
    recorder.scene_update(0, &[city]).unwrap();
}

fn record(path: &Path, ticks: u64) -> Vec<u8> {
    let mut recorder = Recorder::create(Some(path), None, &META).unwrap();
    drive(&mut recorder, ticks).unwrap();
    recorder.finish().unwrap();
    fs::read(path).unwrap()
}

/// Messages readable from the start, up to the first error, of a file that may be cut.
fn readable(bytes: &[u8]) -> Vec<mcap::Message<'_>> {
    MessageStream::new_with_options(bytes, Options::IgnoreEndMagic.into())
        .unwrap()
        .map_while(Result::ok)
        .collect()
}

fn decodes(message: &mcap::Message) -> bool {
    fn ok<M: prost::Message + Default>(data: &[u8]) -> bool {
        // Encoding back must give the same bytes: an unknown field would be dropped.
        M::decode(data).is_ok_and(|decoded| decoded.encode_to_vec() == data)
    }
    let schema = message.channel.schema.as_ref().unwrap();
    let data = &message.data[..];
    match schema.name.as_str() {
        "foxglove.FrameTransforms" => ok::<fg::FrameTransforms>(data),
        "foxglove.SceneUpdate" => ok::<fg::SceneUpdate>(data),
        "foxglove.LocationFix" => ok::<fg::LocationFix>(data),
        "foxglove.Log" => ok::<fg::Log>(data),
        "foxglove.CompressedImage" => ok::<fg::CompressedImage>(data),
        "foxglove.ImageAnnotations" => ok::<fg::ImageAnnotations>(data),
        "foxglove.CameraCalibration" => ok::<fg::CameraCalibration>(data),
        "boresight.Tick" => ok::<proto::Tick>(data),
        "boresight.UavState" => ok::<proto::UavState>(data),
        "boresight.MountState" => ok::<proto::MountState>(data),
        "boresight.TrackState" => ok::<proto::TrackState>(data),
        "boresight.BeamState" => ok::<proto::BeamState>(data),
        "boresight.FrameTruth" => ok::<proto::FrameTruth>(data),
        "boresight.Detections" => ok::<proto::Detections>(data),
        "boresight.MissDistance" => ok::<proto::MissDistance>(data),
        _ => false,
    }
}

#[test]
fn tick_times_are_exact() {
    assert_eq!(log_time_ns(960, HZ), NS);
    assert_eq!(log_time_ns(1, HZ), 1_041_666);
    // A year of ticks: a float of seconds would be off by some nanoseconds.
    assert_eq!(
        log_time_ns(960 * 31_536_000 + 480, HZ),
        31_536_000 * NS + NS / 2
    );
    assert_eq!(log_time_ns(u64::MAX, NonZeroU32::MIN), u64::MAX);
}

#[test]
fn everything_written_reads_back() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = record(&dir.path().join("a.mcap"), 1000);
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.unwrap();
    let expected_topics: Vec<String> = channels(&META)
        .into_iter()
        .map(|(topic, _)| topic)
        .collect();
    let mut topics: Vec<_> = summary.channels.values().collect();
    topics.sort_by_key(|channel| channel.id);
    assert_eq!(
        topics.iter().map(|c| c.topic.clone()).collect::<Vec<_>>(),
        expected_topics
    );
    let mut sequences = BTreeMap::new();
    let mut last = (0, 0);
    let mut count = 0;
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(
            decodes(&message),
            "{} does not decode",
            message.channel.topic
        );
        let next: &mut u32 = sequences.entry(message.channel.id).or_default();
        assert_eq!(message.sequence, *next, "{}", message.channel.topic);
        *next += 1;
        assert!(last <= (message.log_time, message.channel.id), "not sorted");
        last = (message.log_time, message.channel.id);
        count += 1;
    }
    assert_eq!(
        sequences.len(),
        expected_topics.len(),
        "a topic has no message"
    );
    assert_eq!(stats.message_count, count);
    assert_eq!(stats.message_start_time, EPOCH_NS);
    assert_eq!(stats.message_end_time, EPOCH_NS + log_time_ns(999, HZ));
    let image = readable(&bytes)
        .into_iter()
        .find(|m| m.channel.topic == "/ptv/image")
        .unwrap();
    let image = fg::CompressedImage::decode(&image.data[..]).unwrap();
    assert_eq!(
        (&image.data[..2], &image.frame_id[..]),
        (&[0xff, 0xd8][..], "ptv")
    );
}

#[test]
fn same_calls_give_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let a = record(&dir.path().join("a.mcap"), 1500);
    let b = record(&dir.path().join("b.mcap"), 1500);
    assert!(a == b);
    // The order of calls within a tick does not show; another value does.
    let swapped = |first_log: bool, text: &str| {
        let path = dir.path().join("c.mcap");
        let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
        if first_log {
            recorder.log(0, LogLevel::Info, "atp", text).unwrap();
        }
        recorder.own(0, &proto::Tick::default()).unwrap();
        if !first_log {
            recorder.log(0, LogLevel::Info, "atp", text).unwrap();
        }
        drop(recorder);
        fs::read(path).unwrap()
    };
    assert!(swapped(true, "x") == swapped(false, "x"));
    assert!(swapped(true, "x") != swapped(true, "y"));
}

#[test]
fn a_killed_run_loses_less_than_a_second() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("killed.mcap");
    let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
    let empty = fs::read(&path).unwrap();
    assert!(
        empty.windows(13).any(|w| w == b"scenario.toml"),
        "no scenario at the start"
    );
    drive(&mut recorder, 9600).unwrap();
    mem::forget(recorder); // what a kill leaves: no destructor runs, and some ticks wait to be written
    let bytes = fs::read(&path).unwrap();
    let messages = readable(&bytes);
    let last = messages.last().unwrap().log_time;
    let lost_ns = EPOCH_NS + log_time_ns(9599, HZ) - last;
    assert!(lost_ns < 300_000_000, "{lost_ns} ns lost");
    // Cut anywhere, also within a chunk: the chunks before the cut remain.
    let cut = readable(&bytes[..bytes.len() * 6 / 10]);
    let share = cut.len() as f64 / messages.len() as f64;
    // Later messages are a little longer than early ones.
    assert!((0.5..0.62).contains(&share), "{share}");
    assert!(cut.iter().all(decodes));
}

#[test]
fn a_cut_recording_is_read_and_a_damaged_one_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("whole.mcap");
    let overrides = ["description=two\nlines".to_owned(), "name=x".to_owned()];
    let meta = Meta {
        overrides: &overrides,
        pictures: false,
        ..META
    };
    let mut recorder = Recorder::create(Some(&path), None, &meta).unwrap();
    drive(&mut recorder, 960).unwrap();
    recorder.finish().unwrap();
    let bytes = fs::read(&path).unwrap();
    let open = |bytes: &[u8]| {
        let path = dir.path().join("changed.mcap");
        fs::write(&path, bytes).unwrap();
        Recorded::open(&path).unwrap()
    };
    let whole = open(&bytes);
    whole.check().unwrap();
    // There are pictures in it, but its cameras are said to have rendered none.
    assert!(whole.is_whole() && !whole.has_pictures());
    assert_eq!(whole.overrides, overrides);
    // What every recording begins with ends below 3000 bytes.
    for cut in (3000..bytes.len() - 8).step_by(997) {
        let cut = open(&bytes[..cut]);
        assert!(!cut.is_whole());
        cut.check().unwrap();
    }
    // A bit in the middle of a chunk.
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 0x10;
    let error = open(&damaged).check().unwrap_err();
    assert!(matches!(error, ReadError::Damaged { .. }), "{error}");
    assert!(!error.to_string().contains('\n'), "{error}");
    // Also where its end is gone too.
    let error = open(&damaged[..bytes.len() * 3 / 4]).check().unwrap_err();
    assert!(matches!(error, ReadError::Damaged { .. }), "{error}");
}

#[test]
fn failures_are_typed() {
    let missing = Path::new("/nonexistent/directory/a.mcap");
    assert!(matches!(
        Recorder::create(Some(missing), None, &META),
        Err(RecordingError::Create { path, .. }) if path == missing
    ));
    // Linux's full disk.
    assert!(matches!(
        Recorder::create(Some(Path::new("/dev/full")), None, &META),
        Err(RecordingError::DiskFull { .. })
    ));
    let mut recorder = Recorder::create(None, None, &META).unwrap();
    recorder.own(5, &proto::Tick::default()).unwrap();
    assert!(matches!(
        recorder.own(4, &proto::Tick::default()),
        Err(RecordingError::Backwards { tick: 4, last: 5 })
    ));
}

/// A disk that fills up in the middle of a run: every later call reports it, and none panics.
#[test]
fn a_disk_that_fills_up_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let mut file = Mcap::create(&path, &META).unwrap();
    let full = File::options().write(true).open("/dev/full").unwrap();
    let writer = WriteOptions::new()
        .chunk_size(None)
        .disable_seeking(true)
        .create(NoSeek::new(BufWriter::new(full)))
        .unwrap();
    file.writer = writer;
    for (id, _) in &mut file.channels {
        *id = file
            .writer
            .add_channel(0, &format!("/{id}"), "protobuf", &BTreeMap::new())
            .unwrap();
    }
    let sink = Sink {
        file: Some(file),
        live: None,
        written: Written::default(),
    };
    let mut recorder = Recorder::into_sink(sink, &META).unwrap();
    let error = drive(&mut recorder, 960).unwrap_err();
    assert!(matches!(error, RecordingError::DiskFull { .. }), "{error}");
    assert!(drive(&mut recorder, 960).is_err());
    assert!(recorder.finish().is_err());
}

/// What a message path such as `/topic{name=="x"}.field.field` names: topic, and fields on the way.
fn named(path: &str) -> (&str, Vec<Vec<&str>>) {
    let end = path.find(['{', '.']).unwrap_or(path.len());
    let (topic, mut rest) = path.split_at(end);
    let mut fields = Vec::new();
    if let Some((filter, after)) = rest.strip_prefix('{').and_then(|rest| rest.split_once('}')) {
        fields.push(vec![filter.split_once("==").unwrap().0]);
        rest = after;
    }
    fields.extend(rest.strip_prefix('.').map(|rest| rest.split('.').collect()));
    (topic, fields)
}

/// Every text in a JSON value, keys too.
fn texts<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
    match value {
        Value::String(text) => found.push(text),
        Value::Array(values) => values.iter().for_each(|value| texts(value, found)),
        Value::Object(values) => values.iter().for_each(|(key, value)| {
            found.push(key);
            texts(value, found);
        }),
        _ => {}
    }
}

#[test]
fn the_layout_names_topics_and_fields_that_there_are() {
    let path =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("docs/foxglove-layout.json");
    let layout: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let messages: BTreeMap<String, MessageDescriptor> = channels(&META)
        .into_iter()
        .map(|(topic, schema)| {
            let schema = schema.unwrap();
            let pool = DescriptorPool::decode(&*schema.data).unwrap();
            (topic, pool.get_message_by_name(&schema.name).unwrap())
        })
        .collect();
    let mut paths = Vec::new();
    texts(&layout["configById"], &mut paths);
    paths.retain(|text| text.starts_with('/'));
    for path in &paths {
        let (topic, fields) = named(path);
        let message = messages.get(topic);
        let message = message.unwrap_or_else(|| panic!("{path}: no such topic"));
        for way in fields {
            let mut at = Kind::Message(message.clone());
            for field in way {
                let field = at.as_message().and_then(|at| at.get_field_by_name(field));
                at = field
                    .unwrap_or_else(|| panic!("{path}: no such field"))
                    .kind();
            }
            assert!(at.as_message().is_none(), "{path}: is no value");
        }
    }
    // What an engagement is looked at by is on it.
    let of = |schema: &str| {
        let shown = |topic: &&&str| {
            messages
                .get(**topic)
                .is_some_and(|m| m.full_name() == schema)
        };
        paths
            .iter()
            .filter(shown)
            .collect::<std::collections::BTreeSet<_>>()
            .len()
    };
    for schema in ["CompressedImage", "ImageAnnotations", "CameraCalibration"] {
        assert_eq!(
            of(&format!("foxglove.{schema}")),
            META.cameras.len(),
            "{schema}"
        );
    }
    for schema in ["SceneUpdate", "FrameTransforms", "Log"] {
        assert_eq!(of(&format!("foxglove.{schema}")), 1, "{schema}");
    }
    for wanted in [
        "miss_px",
        "power_in_bucket_w",
        "skin_temperature_k",
        "track_state.state",
    ] {
        assert!(paths.iter().any(|path| path.ends_with(wanted)), "{wanted}");
    }
    // Each panel has its place, and each place its panel.
    let mut places = Vec::new();
    texts(&layout["layout"], &mut places);
    places.retain(|text| text.contains('!'));
    places.sort_unstable();
    let panels = layout["configById"].as_object().unwrap();
    assert_eq!(places, panels.keys().collect::<Vec<_>>());
}

#[test]
fn a_timeline_has_what_was_recorded_when() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
    record_city(&mut recorder);
    drive(&mut recorder, 96).unwrap();
    recorder.finish().unwrap();
    let timeline = timeline::Timeline::of(&read::Recorded::open(&path).unwrap());
    assert_eq!((timeline.tick_hz, timeline.last_tick), (960, 95));
    assert!(timeline.whole);
    let [(name, uav)] = &timeline.uavs[..] else {
        panic!("{:?}", timeline.uavs.len())
    };
    assert_eq!(name, "uav-1");
    for tick in [0, 1, 50, 95, 1_000] {
        let at = uav.at(tick).unwrap();
        let known = tick.min(95) as f64 / 960.0;
        assert!((at.r_enu_m.x - 8.0 * known).abs() < 1e-12 && at.r_enu_m.z == 60.0);
        assert!((at.skin_k - 290.0 - known).abs() < 1e-12 && &*at.status == "flying");
    }
    assert_eq!((uav.after(5), uav.before(5)), (Some(6), Some(4)));
    assert_eq!((uav.after(95), uav.before(0)), (None, None));
    // UAVs are no cameras, whatever moves them.
    let cameras: Vec<&str> = timeline.cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(cameras.len(), 3, "{cameras:?}");
    let camera = timeline.cameras.iter().find(|c| c.name == "ctv").unwrap();
    let pictures: Vec<u64> = camera.pictures.entries().iter().map(|(t, _)| *t).collect();
    assert_eq!(pictures, [0, 16, 32, 48, 64, 80]);
    assert_eq!(camera.pictures.entry_at(31).unwrap().0, 16);
    assert_eq!(camera.full_px(), [64, 48]);
}

#[test]
fn a_timeline_has_the_buildings_as_they_stand() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
    record_city(&mut recorder);
    recorder.finish().unwrap();
    let timeline = timeline::Timeline::of(&read::Recorded::open(&path).unwrap());
    let [corners] = &timeline.buildings[..] else {
        panic!("{:?}", timeline.buildings)
    };
    let along = corners[1] - corners[0];
    assert!((along.length() - 40.0).abs() < 1e-9 && (along.to_angle() - 0.3).abs() < 1e-9);
    assert!((corners[2].distance(corners[1]) - 20.0).abs() < 1e-9);
    assert!((0.5 * (corners[0] + corners[2])).distance([100.0, 50.0].into()) < 1e-9);
}

/// What does not count is marked as such, has no text, and lies below what counts.
#[test]
fn weak_boxes_are_told_from_strong_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
    let mark = |score: f64, label: &'static str| BoxAnnotation {
        label,
        rect_px: [10.0 * score, 20.0, 30.0, 27.0],
        score,
        weak: score < 0.25,
    };
    let boxes = [
        mark(0.9, "uav"),
        mark(0.1, "bird"),
        mark(0.4, "uav"),
        mark(0.2, "uav"),
    ];
    let rgb8 = Arc::new(vec![90; 3 * 64 * 48]);
    let picture = Picture {
        rgb8,
        size_px: [64, 48],
        quality: 85,
        most_bytes: usize::MAX,
    };
    recorder.picture(0, 1, picture).unwrap();
    recorder
        .image_annotations(8, 0, 1, &boxes, [32.0, 24.0])
        .unwrap();
    recorder.finish().unwrap();
    let recorded = read::Recorded::open(&path).unwrap();
    let annotations = (recorded.messages())
        .find(|message| message.channel.topic == "/ctv/annotations")
        .unwrap();
    let annotations = fg::ImageAnnotations::decode(&annotations.data[..]).unwrap();
    let texts: Vec<&str> = annotations.texts.iter().map(|t| t.text.as_str()).collect();
    assert_eq!(texts, ["uav", "uav"]);
    let timeline = timeline::Timeline::of(&recorded);
    let camera = timeline.cameras.iter().find(|c| c.name == "ctv").unwrap();
    let marks = camera.marks_at(8).unwrap();
    let boxes: Vec<_> = (marks.boxes.iter())
        .map(|mark| (mark.label.as_str(), mark.weak))
        .collect();
    assert_eq!(
        boxes,
        [
            ("bird 0.10", true),
            ("uav 0.20", true),
            ("uav 0.40", false),
            ("uav 0.90", false)
        ]
    );
    assert_eq!(marks.boxes[3].rect_px, [9.0, 20.0, 30.0, 27.0]);
    assert_eq!(marks.reticle_px, Some([32.0, 24.0]));
}

/// The number by which an order chooses a track is there, 0 too, and absent without a track.
#[test]
fn a_track_state_carries_the_number_that_orders_want() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
    let state = |track| proto::TrackState {
        track,
        ..Default::default()
    };
    for (tick, track) in [(0, None), (1, Some(0)), (2, Some(7))] {
        recorder.own(tick, &state(track)).unwrap();
    }
    recorder.finish().unwrap();
    let recorded = read::Recorded::open(&path).unwrap();
    // By the schema in the file alone, as Foxglove and Python read it.
    let mut decoder = read::Decoder::default();
    let found: Vec<Value> = (recorded.messages())
        .map(|message| decoder.decode(&message).unwrap()["track"].clone())
        .collect();
    assert_eq!(found, [Value::Null, 0.into(), 7.into()]);
}

/// Noise takes no more of a recording than its bound, whatever the order of the cameras' calls; what is large is warned of.
#[test]
fn noisy_pictures_are_bounded_and_a_large_recording_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let size = |most_bytes: usize| {
        let path = folder.path().join("run.mcap");
        let mut recorder = Recorder::create(Some(&path), None, &META).unwrap();
        let mut rng = boresight_models::maths::rng::Stream::new(1, 0, "noise");
        let mut noise = || (40.0 + 12.0 * rng.normal()).round() as u8;
        for tick in 0..10 {
            let picture = Picture {
                rgb8: Arc::new((0..3 * 320 * 240).map(|_| noise()).collect()),
                size_px: [320, 240],
                quality: 90,
                most_bytes,
            };
            recorder.picture(96 * tick, 0, picture).unwrap();
        }
        let written = recorder.finish().unwrap();
        assert_eq!(written.bytes, fs::metadata(&path).unwrap().len());
        written
    };
    let (free, bound) = (size(usize::MAX), size(9_600));
    assert!(bound.picture_bytes <= 10 * 9_600, "{bound:?}");
    assert!(free.picture_bytes > 4 * bound.picture_bytes, "{free:?}");
    let path = Path::new("run.mcap");
    assert_eq!(bound.warning(path, 1.0), None);
    let much = Written {
        bytes: 50_000_000,
        picture_bytes: 45_000_000,
    };
    assert_eq!(much.warning(path, 20.0), None);
    let short = Written {
        bytes: 7_900_000,
        picture_bytes: 0,
    };
    assert_eq!(short.warning(path, 0.1), None);
    assert_eq!(
        much.warning(path, 10.0).unwrap().to_string(),
        "run.mcap: size: 50 MB, 5.0 MB a simulated second, 90 % of it pictures; keep fewer or coarser ones by \
         record.images = { every = 4 } or a lower record.picture_bits_per_px"
    );
}
