//! What the tests share: the command, its runs and their recordings.

use bevy::prelude::{Component, World};
use boresight::components::mount::first_station;
use boresight::recording::proto;
use boresight::simulation::{Builder, Simulation, StationView};
use prost::Message as _;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tempfile::TempDir;

pub const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// What a run without images needs.
pub const BLIND: [&str; 3] = ["--set", "detector.kind=truth", "--no-capture"];

/// Held while something renders.
pub fn rendering() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A shipped scenario with these values set, to be opened.
pub fn scenario(name: &str, set: &[impl AsRef<str>]) -> Builder {
    let path = Path::new(ROOT).join(format!("scenarios/{name}.toml"));
    let values = set.iter().map(AsRef::as_ref);
    values.fold(Simulation::builder(path), |builder, value| {
        builder.set(value)
    })
}

/// The first station of a run.
pub fn station(run: &Simulation) -> StationView<'_> {
    let mut stations = run.view().stations();
    stations.next().expect("a run has a station")
}

/// What the first station has.
pub fn of<C: Component>(world: &World) -> &C {
    first_station(world).expect("a station has all its parts")
}

pub fn boresight() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_boresight"));
    // Mesa complains on standard error where a session has none.
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
    }
    // Scenarios name models relative to the working directory.
    command
        .current_dir(ROOT)
        .env_remove("RUST_LOG")
        .stdin(Stdio::null());
    command
}

/// The command on a virtual display.
pub fn on_display() -> Command {
    let boresight = boresight();
    let mut command = Command::new("xvfb-run");
    // Each test looks for a free display from a number of its own: two that look at once would find the same.
    static DISPLAY: AtomicU32 = AtomicU32::new(99);
    let from = DISPLAY.fetch_add(20, Ordering::Relaxed);
    command.args(["-n", &from.to_string(), "-a"]);
    command.arg(boresight.get_program());
    for (key, value) in boresight.get_envs() {
        match value {
            Some(value) => command.env(key, value),
            None => command.env_remove(key),
        };
    }
    command.current_dir(ROOT).stdin(Stdio::null());
    command
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What a command says on standard error but for how far it has come, which it says every ten seconds.
pub fn complaints(output: &Output) -> String {
    let text = stderr(output);
    let kept = text.lines().filter(|line| !line.ends_with(" neutralised"));
    kept.collect::<Vec<_>>().join("\n")
}

/// A finished run's folder and summary.
pub struct Run {
    pub folder: TempDir,
    pub summary: Value,
}

impl Run {
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn hash(&self) -> &str {
        self.summary["state_hash"].as_str().unwrap()
    }

    pub fn text(&self, key: &str) -> &str {
        self.summary[key].as_str().unwrap()
    }

    pub fn number(&self, pointer: &str) -> f64 {
        let value = self.summary.pointer(pointer).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("{pointer} is no number in {:#}", self.summary))
    }
}

/// Runs a shipped scenario to its end, which must succeed.
pub fn run_scenario(name: &str, args: &[&str]) -> Run {
    let folder = TempDir::new().unwrap();
    let started = Instant::now();
    let output = boresight()
        .arg("run")
        .arg(format!("scenarios/{name}.toml"))
        .arg("--out")
        .arg(folder.path())
        .args(args)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{name} {args:?}: {}: {}",
        output.status,
        stderr(&output)
    );
    assert_eq!(complaints(&output), "", "{name} {args:?}");
    let summary = std::fs::read_to_string(folder.path().join("summary.json")).unwrap();
    println!("{name} {args:?}: {:.1} s", started.elapsed().as_secs_f64());
    Run {
        folder,
        summary: serde_json::from_str(&summary).unwrap(),
    }
}

pub fn messages(mcap: &Path, topic: &str) -> Vec<Vec<u8>> {
    let bytes = std::fs::read(mcap).unwrap();
    mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| message.unwrap())
        .filter(|message| message.channel.topic == topic)
        .map(|message| message.data.into_owned())
        .collect()
}

/// (tick, state hash) of every tick in a recording.
pub fn tick_hashes(run: &Run) -> Vec<(u64, u64)> {
    messages(&run.file("run.mcap"), "/boresight/tick")
        .iter()
        .map(|data| proto::Tick::decode(&data[..]).unwrap())
        .map(|tick| (tick.tick, tick.state_hash))
        .collect()
}

/// A Python script of the tests; none where Python or one of the modules it imports is not there.
pub fn python(script: &str, modules: &str) -> Option<Command> {
    let Some(python) = std::env::var_os("BORESIGHT_PYTHON") else {
        println!("SKIP: BORESIGHT_PYTHON is not set; ./test sets it");
        return None;
    };
    let mut imports = Command::new(&python);
    let imports = imports.args(["-c", &format!("import {modules}")]).output();
    if !imports.is_ok_and(|output| output.status.success()) {
        let python = python.display();
        println!("SKIP: {python} lacks one of {modules}; ./test installs them");
        return None;
    }
    let mut command = Command::new(python);
    command.arg(Path::new(ROOT).join(script));
    Some(command)
}

/// Reads a recording with the format's own Python library, as an outside user would.
pub fn read_with_python(mcap: &Path, pictures: bool) {
    let Some(mut reader) = python("tests/read_mcap.py", "mcap, mcap_protobuf") else {
        return;
    };
    let output = reader.arg(mcap).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}{}", stderr(&output));
    assert!(text.contains("\ncomplete, "), "{text}");
    let count = |topic: &str| {
        let line = text.lines().find(|line| line.ends_with(topic));
        let count = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
        count.unwrap_or_else(|| panic!("no topic {topic} in\n{text}"))
    };
    let topics = [
        "foxglove.FrameTransforms",
        "foxglove.SceneUpdate",
        "foxglove.CompressedImage",
        "foxglove.ImageAnnotations",
        "foxglove.CameraCalibration",
        "foxglove.LocationFix",
        "foxglove.Log",
    ];
    for schema in topics {
        assert!(text.contains(schema), "no {schema} in\n{text}");
    }
    for topic in [
        "/boresight/tick",
        "/boresight/uav_state",
        "/boresight/mount_state",
        "/boresight/track_state",
        "/boresight/beam_state",
        "/boresight/frame_truth",
        "/boresight/detections",
        "/boresight/miss_distance",
    ] {
        assert!(count(topic) > 0, "no message on {topic} in\n{text}");
    }
    for topic in ["/stv/image", "/ctv/image", "/ptv/image"] {
        assert_eq!(count(topic) > 0, pictures, "{topic} in\n{text}");
    }
    assert!(text.contains("attachment: scenario"), "{text}");
}

/// Asserts that a command ends with 2 and one line that says `wanted`.
#[track_caller]
pub fn refused(command: &mut Command, wanted: &[&str]) {
    let output = command.output().unwrap();
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{command:?}: {text}");
    assert!(!text.contains("panicked"), "{command:?}: {text}");
    let lines: Vec<_> = text.lines().collect();
    assert!(
        lines.len() == 1 && lines[0].starts_with("error: "),
        "{command:?}: {text}"
    );
    for words in wanted {
        assert!(text.contains(words), "{command:?}: no '{words}' in {text}");
    }
}
