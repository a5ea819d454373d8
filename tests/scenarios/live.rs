//! A run as those see it who look on over Foxglove's WebSocket.

use crate::common::{BLIND, boresight, python, refused, run_scenario, stderr};
use std::io::{BufRead as _, BufReader};
use std::net::TcpListener;
use std::process::Stdio;
use std::time::Instant;
use tempfile::TempDir;

const SCENARIO: &str = "scenarios/urban_intercept.toml";

#[test]
fn a_run_is_served_as_it_is_recorded_and_goes_as_without() {
    let Some(mut reader) = python("tests/read_live.py", "mcap, mcap_protobuf, websockets") else {
        return;
    };
    let short = ["--set", "duration_s=3"];
    let folder = TempDir::new().unwrap();
    let started = Instant::now();
    let mut run = boresight()
        .args(["run", SCENARIO, "--live", "127.0.0.1:0", "--pace", "1"])
        .args([&BLIND[..], &short].concat())
        .arg("--out")
        .arg(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(run.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    let address = line.trim_end().strip_prefix("live  ").expect(&line);
    let recording = folder.path().join("run.mcap");
    let output = reader.arg(address).arg(&recording).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    // Somebody who takes nothing is connected to the end.
    assert!(run.wait().unwrap().success());
    let elapsed_s = started.elapsed().as_secs_f64();
    assert!((2.9..20.0).contains(&elapsed_s), "{elapsed_s} s");
    assert!(output.status.success(), "{text}{}", stderr(&output));
    for topic in [
        "/tf",
        "/scene",
        "/site/location",
        "/log",
        "/boresight/tick",
        "/boresight/uav_state",
        "/boresight/track_state",
        "/boresight/detections",
    ] {
        let line = text.lines().find(|line| line.ends_with(topic));
        let count = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
        assert!(count.is_some_and(|count| count > 0), "{topic} in\n{text}");
    }
    let mut rest = String::new();
    said.read_line(&mut rest).unwrap();
    assert_eq!(rest, "");

    let without = run_scenario("urban_intercept", &[&BLIND[..], &short].concat());
    let bytes = |path| std::fs::read(path).unwrap();
    assert!(bytes(without.file("run.mcap")) == bytes(recording));
}

#[test]
fn an_address_that_cannot_be_had_is_one_error() {
    let folder = TempDir::new().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let command = |options: &[&str]| {
        let mut command = boresight();
        command.args(["run", SCENARIO]).args(BLIND).args(options);
        command.arg("--out").arg(folder.path().join("out"));
        command
    };
    refused(
        &mut command(&["--live", &address]),
        &["--live", "cannot listen on", &address],
    );
    for options in [["--live", "nowhere"], ["--pace", "0"], ["--pace", "nan"]] {
        let output = command(&options).output().unwrap();
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {text}");
        assert!(
            text.contains(options[0]) && text.contains(options[1]),
            "{text}"
        );
    }
}
