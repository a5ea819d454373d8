//! Commands that are stopped by Ctrl-C (SIGINT) or SIGTERM: what they leave is whole, and they say how to go on.

use crate::common::{BLIND, ROOT, Run, boresight, complaints, run_scenario, stderr, tick_hashes};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The longest that a command may go on after a signal, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Sends a signal by its name.
fn send(signal: &str, child: &Child) {
    let pid = child.id().to_string();
    let status = Command::new("kill").args(["-s", signal, &pid]).status();
    assert!(status.unwrap().success(), "kill -s {signal} {pid}");
}

fn begin(command: &mut Command) -> Child {
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Waits until something is so; it must become so while the command goes on.
fn wait_for(child: &mut Child, what: impl Fn() -> bool) {
    let begun = Instant::now();
    while !what() {
        assert_eq!(child.try_wait().unwrap(), None, "it has ended too early");
        assert!(begun.elapsed() < PATIENCE, "it does not begin");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits for its end, which must come soon.
fn end(mut child: Child) -> Output {
    let begun = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begun.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("it goes on after the signal");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap()
}

fn size(path: &Path) -> u64 {
    path.metadata().map_or(0, |of| of.len())
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A blind run of some simulated minutes, begun; it is stopped once its recording grows.
fn stopped(signals: &[&str]) -> (Run, Output) {
    let folder = TempDir::new().unwrap();
    let mut child = begin(
        boresight()
            .args(["run", "scenarios/urban_intercept.toml"])
            .args(BLIND)
            // Slower than it could go, so that it is still at work; with nothing to end it early.
            .args([
                "--set",
                "duration_s=600",
                "--set",
                "engage.authorised=false",
            ])
            .args(["--pace", "5", "--out"])
            .arg(folder.path()),
    );
    let recording = folder.path().join("run.mcap");
    // The head alone is smaller.
    wait_for(&mut child, || size(&recording) > 100_000);
    for signal in signals {
        send(signal, &child);
    }
    let output = end(child);
    let summary = std::fs::read(folder.path().join("summary.json")).unwrap_or_default();
    let run = Run {
        folder,
        summary: serde_json::from_slice(&summary).unwrap_or_default(),
    };
    (run, output)
}

#[test]
fn a_stopped_run_is_whole_until_then() {
    for (signal, code, name) in [("INT", 130, "Ctrl-C"), ("TERM", 143, "SIGTERM")] {
        let (run, output) = stopped(&[signal]);
        let text = said(&output);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{text}{}",
            stderr(&output)
        );
        assert_eq!(complaints(&output), "");
        let stopped_s = run.number("/stopped_s");
        assert!(0.0 < stopped_s && stopped_s < 600.0, "{stopped_s}");
        assert_eq!(stopped_s, run.number("/simulated_s"));
        assert!(
            run.text("reason").contains("stopped at"),
            "{}",
            run.text("reason")
        );
        let last = text.lines().last().unwrap();
        assert!(last.starts_with(&format!("stopped by {name}: ")), "{text}");
        assert!(
            last.contains("run.mcap") && last.contains("the same command"),
            "{text}"
        );
        let report = std::fs::read_to_string(run.file("report.html")).unwrap();
        assert!(report.contains("stopped at") && report.contains("</html>"));
        // Its ticks are the first ones of the whole run.
        let ticks = tick_hashes(&run);
        let (last, hash) = ticks[ticks.len() - 1];
        assert_eq!(format!("{hash:016x}"), run.hash());
        if name == "Ctrl-C" {
            let whole = format!("duration_s={}", stopped_s + 1.0);
            let args = [
                &BLIND[..],
                &["--set", "engage.authorised=false", "--set", &whole],
            ]
            .concat();
            let whole = run_scenario("urban_intercept", &args);
            let all = tick_hashes(&whole);
            assert!(
                all.len() > ticks.len() && all[..ticks.len()] == ticks[..],
                "{last}"
            );
            let diff = boresight()
                .arg("diff")
                .args([run.file("run.mcap"), whole.file("run.mcap")])
                .output()
                .unwrap();
            let text = said(&diff);
            assert!(
                text.starts_with("equal to ") && !text.contains("lacks its end"),
                "{text}"
            );
        }
    }
}

#[test]
fn the_second_signal_ends_a_run_at_once() {
    let folder = TempDir::new().unwrap();
    // A tick takes a minute of the wall clock: the first signal is obeyed after that.
    let mut child = begin(
        boresight()
            .args(["run", "scenarios/urban_intercept.toml"])
            .args(BLIND)
            .args(["--pace", "0.00002", "--out"])
            .arg(folder.path()),
    );
    wait_for(&mut child, || folder.path().join("run.mcap").exists());
    // Until it listens, a signal ends it as any program.
    std::thread::sleep(Duration::from_secs(2));
    send("INT", &child);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(child.try_wait().unwrap(), None, "the first only asks");
    send("TERM", &child);
    let begun = Instant::now();
    let output = end(child);
    assert_eq!(output.status.code(), Some(143), "{}", stderr(&output));
    assert!(begun.elapsed().as_secs() < 10);
    assert!(!folder.path().join("summary.json").exists());
}

/// A command that is stopped as soon as something is so.
fn broken_off(
    command: &mut Command,
    signal: &str,
    when: impl Fn() -> bool,
) -> (ExitStatus, String) {
    let mut child = begin(command);
    wait_for(&mut child, when);
    send(signal, &child);
    let output = end(child);
    (output.status, said(&output) + &stderr(&output))
}

#[test]
fn a_stopped_sweep_goes_on_and_a_stopped_test_says_so() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    let demo = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let experiment = format!(
        "name = 'many'\nscenario = '{}'\nset = ['detector.kind=truth', 'duration_s=3', 'engage.authorised=false']\n\
         seeds = '1..=200'\nkeep = ['stopped_s', 'simulated_s']\n\
         [[factors]]\nkey = 'station.laser.power_w'\nvalues = [500.0]\n",
        demo.display()
    );
    std::fs::write(path("sweep.toml"), &experiment).unwrap();
    let sweep = |out: &str| {
        let mut command = boresight();
        command
            .arg("sweep")
            .arg(path("sweep.toml"))
            .arg("--out")
            .arg(path(out));
        command
    };
    let journal = path("out").join("runs-all.jsonl");
    let lines = || std::fs::read_to_string(&journal).map_or(0, |text| text.lines().count());
    let (status, text) = broken_off(&mut sweep("out"), "INT", || lines() > 3);
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(text.contains("stopped by Ctrl-C: "), "{text}");
    assert!(text.contains("the same command goes on"), "{text}");
    assert!(!path("out").join("table.csv").exists());
    let made = lines() - 1;
    assert!((3..200).contains(&made), "{made}");
    // Fewer seeds are among those that were asked for: with them it is soon done.
    let few = experiment.replace("'1..=200'", &format!("'1..={}'", made + 1));
    std::fs::write(path("sweep.toml"), few).unwrap();
    let output = sweep("out").output().unwrap();
    let text = said(&output);
    assert!(output.status.success(), "{text}{}", stderr(&output));
    assert!(text.contains(" of them made before, 0 failed"), "{text}");
    let table = std::fs::read_to_string(path("out").join("table.csv")).unwrap();
    // What was stopped midway is no run: none of the rows says that it was.
    for row in table.lines().skip(1) {
        assert!(row.contains(",,3,"), "{row}");
    }

    let scenario = std::fs::read_to_string(&demo).unwrap();
    let own = scenario.split("[expect]").next().unwrap();
    let expect = "[expect]\nblind = true\nseeds = '1..=500'\noutcome = 'neutralised'\n";
    std::fs::write(path("long.toml"), format!("{own}\n{expect}")).unwrap();
    let mut command = boresight();
    let command = command
        .arg("test")
        .arg(path("long.toml"))
        .arg("--json")
        .arg(path("t.json"));
    let begun = Instant::now();
    let (status, text) = broken_off(command, "TERM", || begun.elapsed().as_secs() > 2);
    assert_eq!(status.code(), Some(143), "{text}");
    assert!(text.contains("1 stopped"), "{text}");
    assert!(
        text.contains("stopped by SIGTERM: the same command"),
        "{text}"
    );
    let json: Value = serde_json::from_slice(&std::fs::read(path("t.json")).unwrap()).unwrap();
    assert_eq!(json["scenarios"][0]["verdict"], "stopped");
    assert!(json["elapsed_s"].as_f64().unwrap() > 1.0);
}

#[test]
fn a_stopped_evaluation_keeps_what_it_has() {
    let folder = TempDir::new().unwrap();
    let out = |name: &str| folder.path().join(name);
    // Before anything is whole: one sentence, and nothing that looks like a result.
    let begun = Instant::now();
    let mut command = boresight();
    let command = command
        .args(["eval", "tracking", "--only", "suite", "--out"])
        .arg(out("tracking"));
    let (status, text) = broken_off(command, "INT", || begun.elapsed().as_secs() > 2);
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(text.contains("the same command begins again"), "{text}");
    assert!(!out("tracking").join("tracking.json").exists());
    // Draws that are made are counted, and the next call goes on.
    let evaluate = |n: &str| {
        let mut command = boresight();
        command
            .args(["eval", "engagement", "--truth", "--jobs", "1", "--n", n])
            .args(["--recipe", "tests/data/engagement.toml", "--out"])
            .arg(out("engagement"));
        command
    };
    let made = || {
        let files = std::fs::read_dir(out("engagement"))
            .into_iter()
            .flatten()
            .flatten();
        let mut draws = 0;
        for file in files {
            let inside = std::fs::read_dir(file.path())
                .into_iter()
                .flatten()
                .flatten();
            draws += inside
                .filter(|of| of.path().extension().is_some_and(|end| end == "json"))
                .count();
        }
        draws
    };
    let (status, text) = broken_off(&mut evaluate("500"), "INT", || made() > 0);
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(
        text.contains(" of 500 draws are made and counted here"),
        "{text}"
    );
    let results = std::fs::read(out("engagement").join("results.json")).unwrap();
    let results: Value = serde_json::from_slice(&results).unwrap();
    assert!(
        results["stopped"]
            .as_str()
            .unwrap()
            .starts_with("stopped by Ctrl-C")
    );
    assert!(!results["draws"].as_array().unwrap().is_empty());
    let page = std::fs::read_to_string(out("engagement").join("results.html")).unwrap();
    assert!(page.contains("stopped by Ctrl-C"));
}
