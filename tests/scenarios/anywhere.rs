//! Commands from a folder with nothing in it, and scenarios that are begun anew.

use crate::common::{BLIND, ROOT, boresight, refused, rendering, stderr};
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

/// The command in a folder.
fn within(folder: &Path) -> Command {
    let mut command = boresight();
    command.current_dir(folder).env_remove("BORESIGHT_DATA");
    command
}

fn done(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", stderr(&output));
    output
}

#[test]
fn run_check_and_eval_work_in_an_empty_folder() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    // With the shipped network, whose file is not here.
    let scenario = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    done(within(folder).arg("check").arg(&scenario));
    {
        let _one = rendering();
        let short = ["--set", "duration_s=0.2", "--out", "pictures"];
        done(within(folder).arg("run").arg(&scenario).args(short));
    }
    // Named as it lies in the program's data.
    done(within(folder).args(["check", "scenarios/two_stations.toml"]));
    let short = ["--set", "duration_s=0.2", "--out", "blind"];
    done(
        within(folder)
            .args(["run", "scenarios/urban_intercept.toml"])
            .args(BLIND)
            .args(short),
    );
    assert!(folder.join("blind/summary.json").is_file());
    let blind = [
        "--truth",
        "--n",
        "1",
        "--set",
        "duration_s=1.2",
        "--out",
        "drawn",
    ];
    done(within(folder).args(["eval", "engagement"]).args(blind));
    assert!(folder.join("drawn").is_dir());
    // A folder that is named comes first, and what is nowhere is one error.
    let mut named = within(folder);
    named.env("BORESIGHT_DATA", folder);
    std::fs::create_dir(folder.join("own")).unwrap();
    std::fs::copy(&scenario, folder.join("own/mine.toml")).unwrap();
    done(named.args(["check", "own/mine.toml"]));
    refused(
        within(folder).args(["check", "scenarios/absent.toml"]),
        &["scenarios/absent.toml: cannot be read"],
    );
}

#[test]
fn a_new_scenario_passes_its_check_without_a_warning_and_runs() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    done(within(folder).args(["new", "first"]));
    let checked =
        done(within(folder).args(["check", "first.toml", "--map", "map.svg", "--strict"]));
    assert_eq!(stderr(&checked), "");
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(
        said.contains("first seen s") && said.trim_end().ends_with("first.toml: ok"),
        "{said}"
    );
    let map = std::fs::read_to_string(folder.join("map.svg")).unwrap();
    assert!(map.starts_with("<svg") && map.contains("intruder"));
    let short = ["--set", "duration_s=1.0", "--out", "out"];
    done(
        within(folder)
            .args(["run", "first.toml"])
            .args(BLIND)
            .args(short),
    );
    done(within(folder).args(["new", "second", "--from", "two_stations"]));
    done(within(folder).args(["check", "second.toml"]));
    refused(
        within(folder).args(["new", "first.toml"]),
        &["first.toml: is there already"],
    );
}

#[test]
fn a_check_tells_all_errors_at_once() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("bad.toml");
    let text = std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml"));
    let text = (text.unwrap())
        .replacen("duration_s = 25.0", "duration_s = -25.0", 1)
        .replacen("latitude_deg = 47.3769", "latitude_deg = \"north\"", 1)
        .replacen("width_deg = 60.0", "widht_deg = 60.0", 1)
        .replacen("\"phantom4\"", "\"phantom9\"", 1);
    std::fs::write(&path, text).unwrap();
    let output = boresight().arg("check").arg(&path).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    let lines: Vec<&str> = said.lines().collect();
    let want = [
        "bad.toml:3: duration_s: found -25",
        "bad.toml:8: site.latitude_deg: invalid type",
        "bad.toml:19: search.widht_deg: unknown key - did you mean 'width_deg'?",
        "bad.toml:28: uavs[0].model: unknown model 'phantom9'",
    ];
    assert_eq!(lines.len(), want.len(), "{said}");
    for (line, want) in lines.iter().zip(want) {
        assert!(
            line.starts_with("error: ") && line.contains(want),
            "{line}\n{want}"
        );
    }
    // A run ends with the first of them.
    let mut run = boresight();
    run.arg("run")
        .arg(&path)
        .args(BLIND)
        .arg("--out")
        .arg(folder.path().join("out"));
    refused(&mut run, &["bad.toml:3: duration_s"]);
}

#[test]
fn what_makes_no_sense_is_a_warning_and_an_error_where_it_is_asked() {
    let scenario = ["check", "scenarios/urban_intercept.toml"];
    let weak = ["--set", "station.laser.power_w=3.0"];
    let warned = done(boresight().args(scenario).args(weak));
    let said = stderr(&warned);
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.starts_with("warning: scenarios/urban_intercept.toml: --set station.laser.power_w=3.0: station.laser.power_w: 3 W"),
        "{said}"
    );
    let strict = boresight()
        .args(scenario)
        .args(weak)
        .arg("--strict")
        .output()
        .unwrap();
    assert_eq!(strict.status.code(), Some(2));
    assert!(
        stderr(&strict).contains("error: --strict"),
        "{}",
        stderr(&strict)
    );
}
