//! Expectations, comparisons and recordings run again, by the commands.

use crate::common::{BLIND, ROOT, boresight, on_display, refused, run_scenario, stderr};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// `urban_intercept`'s scenario, cut to two seconds, with these expectations of blind runs.
fn expecting(folder: &Path, name: &str, expect: &str) -> PathBuf {
    let demo = std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml"));
    let demo = demo
        .unwrap()
        .replace("duration_s = 25.0", "duration_s = 2.0");
    let own = demo.split("[expect]").next().unwrap();
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, format!("{own}\n[expect]\nblind = true\n{expect}\n")).unwrap();
    path
}

fn test(path: &Path, more: &[&str]) -> (i32, String) {
    let output = boresight()
        .arg("test")
        .arg(path)
        .args(more)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
    (output.status.code().unwrap(), text)
}

#[test]
fn what_is_not_as_expected_turns_the_test_red() {
    let folder = TempDir::new().unwrap();
    for (name, expect, code, wanted) in [
        (
            "right",
            "outcome = 'tracked'\nvalues.energy_j.at_least = 0",
            0,
            "1 met",
        ),
        (
            "outcome",
            "outcome = 'neutralised'",
            1,
            "expected neutralised",
        ),
        (
            "bound",
            "values.time_to_acquire_s.at_most = 0.01",
            1,
            "at most 0.01",
        ),
        (
            "hash",
            "state_hash = { x86_64-linux = '0123456789abcdef', aarch64-linux = '0123456789abcdef' }",
            1,
            "expected 0123456789abcdef",
        ),
        (
            "seeds",
            "seeds = '1..=3'\nshares = [{ at_least = 0.5, confidence = 0.95, outcome = 'neutralised' }]",
            1,
            "shares[0]: 0 of 3 runs",
        ),
        (
            "key",
            "values.dwel_s.at_most = 1",
            2,
            "did you mean 'dwell_s'",
        ),
        ("word", "outcome = 'won'", 2, "expect.outcome"),
        ("range", "seeds = '3..=1'", 2, "expected seeds such as"),
        ("empty", "values.dwell_s = {}", 2, "bounds nothing"),
    ] {
        let path = expecting(folder.path(), name, expect);
        let (found, text) = test(&path, &[]);
        assert_eq!(found, code, "{name}: {text}");
        assert!(text.contains(wanted), "{name}: {text}");
        assert!(!text.contains("panicked"), "{name}: {text}");
    }
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    refused(boresight().arg("test").arg(&empty), &["holds no scenario"]);
    refused(
        boresight().args(["test", "scenarios", "--junit", "/proc/none/t.xml"]),
        &["/proc/none/t.xml", "--junit"],
    );
    refused(
        boresight().args(["test", "nowhere"]),
        &["nowhere", "cannot be read"],
    );
}

#[test]
fn a_blessed_hash_holds_and_the_results_are_written() {
    let folder = TempDir::new().unwrap();
    let scenarios = folder.path().join("scenarios");
    std::fs::create_dir(&scenarios).unwrap();
    let path = expecting(&scenarios, "blessed", "# Kept.\noutcome = 'tracked'");
    expecting(&scenarios, "wrong", "outcome = 'crashed'");
    // What it writes is what it says then.
    let (code, text) = test(&path, &["--bless"]);
    assert!(code == 0 && !text.contains("NOT MET"), "{text}");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(
        text.contains("state_hash") && text.contains("# Kept."),
        "{text}"
    );
    assert_eq!(test(&path, &[]).0, 0);
    // Another seed gives another hash.
    let other = text.replacen("duration_s", "seed = 2\nduration_s", 1);
    std::fs::write(&path, &other).unwrap();
    assert_eq!(test(&path, &[]).0, 1);
    let (code, text2) = test(&path, &["--bless"]);
    assert!(code == 0 && !text2.contains("NOT MET"), "{text2}");
    let others = other.replace("[expect]", "[expect]\nseeds = [7]");
    std::fs::write(&path, others).unwrap();
    let (code, text2) = test(&path, &["--bless"]);
    assert!(code == 2 && text2.contains("add it there"), "{text2}");
    std::fs::write(&path, text).unwrap();

    let (json, xml) = (folder.path().join("t.json"), folder.path().join("t.xml"));
    let files = [
        "--json",
        json.to_str().unwrap(),
        "--junit",
        xml.to_str().unwrap(),
    ];
    assert_eq!(test(&scenarios, &files).0, 1);
    let json: Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let verdicts: Vec<_> = (json["scenarios"].as_array().unwrap().iter())
        .map(|tested| tested["verdict"].as_str().unwrap())
        .collect();
    assert_eq!(verdicts, ["met", "not_met"]);
    if let Some(python) = std::env::var_os("BORESIGHT_PYTHON") {
        let script = Path::new(ROOT).join("tests/read_junit.py");
        let output = Command::new(python).arg(script).arg(&xml).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{text}{}", stderr(&output));
        assert!(text.contains("2 tests, 1 failure"), "{text}");
    } else {
        println!("SKIP: BORESIGHT_PYTHON is not set; ./test sets it");
    }
}

/// `boresight diff`, its exit code and what it says.
fn diff(args: &[&Path]) -> (i32, String) {
    let output: Output = boresight().arg("diff").args(args).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
    (output.status.code().unwrap(), text)
}

#[test]
fn two_recordings_are_compared_and_one_is_run_again() {
    let run = |more: &[&str]| {
        let args = [&BLIND[..], &["--set", "duration_s=3"], more].concat();
        run_scenario("urban_intercept", &args)
    };
    let (one, same, other) = (run(&[]), run(&[]), run(&["--seed", "2"]));
    let weaker = run(&["--set", "station.laser.power_w=500"]);
    let mcap = [&one, &same, &other, &weaker].map(|run| run.file("run.mcap"));
    let (code, text) = diff(&[&mcap[0], &mcap[1]]);
    // The verdict stands first.
    assert!(code == 0 && text.starts_with("equal: "), "{text}");
    assert!(text.contains(" messages to 3.000 s"), "{text}");
    let (code, text) = diff(&[&mcap[0], &mcap[2]]);
    assert!(code == 1 && text.contains("first     tick "), "{text}");
    let verdict = text.lines().next().unwrap();
    assert!(verdict.starts_with("they part at tick "), "{text}");
    assert!(verdict.contains(" s, in /"), "{text}");
    assert!(text.contains("seed      1 | 2"), "{text}");
    // What is recorded more rarely is the same run.
    let rarer = run(&["--set", "record.state_hz=60"]);
    let (code, text) = diff(&[&mcap[0], &rarer.file("run.mcap")]);
    assert_eq!(code, 1, "{text}");
    assert!(text.starts_with("the states are equal, "), "{text}");
    // The laser's power shows when the laser does: what is seen to differ first is the beam.
    let (code, text) = diff(&[&mcap[0], &mcap[3]]);
    assert_eq!(code, 1, "{text}");
    assert!(text.contains("station.laser.power_w=500"), "{text}");
    let verdict = text.lines().next().unwrap();
    assert!(verdict.contains("in /boresight/beam_state"), "{text}");

    // The recording alone: its scenario, changes and seed make the same run again.
    let (code, text) = diff(&[&mcap[2]]);
    assert!(code == 0 && text.contains("equal"), "{text}");
    let again = TempDir::new().unwrap();
    let output = boresight()
        .arg("run")
        .arg(&mcap[2])
        .args(["--no-capture", "--out"])
        .arg(again.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let summary = std::fs::read(again.path().join("summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["state_hash"], *other.hash());
    assert_eq!(summary["seed"], 2);

    // Of a run that was stopped the rest is compared.
    let cut = again.path().join("cut.mcap");
    let bytes = std::fs::read(&mcap[0]).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let (code, text) = diff(&[&mcap[0], &cut]);
    assert!(code == 0 && text.contains("lacks its end"), "{text}");
    // One that was cut before its first messages, and one that was damaged, are equal to nothing.
    let after = |from: usize, word: &[u8]| {
        let at = bytes[from..].windows(word.len()).position(|w| w == word);
        from + at.unwrap() + word.len()
    };
    let head = after(after(0, b"epoch_unix_ns"), b"tick_hz") + 40;
    std::fs::write(&cut, &bytes[..head]).unwrap();
    let (code, text) = diff(&[&mcap[0], &cut]);
    assert!(
        code == 1 && text.starts_with("nothing to compare"),
        "{text}"
    );
    let mut damaged = bytes.clone();
    // Inside a chunk: 04 22 4D 18 begins its LZ4 frame.
    damaged[after(bytes.len() / 2, b"\x04\x22\x4d\x18") + 200] ^= 0x10;
    std::fs::write(&cut, &damaged).unwrap();
    refused(
        boresight().arg("diff").arg(&mcap[0]).arg(&cut),
        &["cut.mcap", "is damaged"],
    );
    // A recording is not written over by the run that is made from it.
    refused(
        (boresight().arg("run").arg(&mcap[0]).arg("--out")).arg(one.folder.path()),
        &["run.mcap", "--out"],
    );
    // What is no recording is refused.
    for (name, bytes, wanted) in [
        ("text.mcap", &b"no recording"[..], "no MCAP recording"),
        ("empty.mcap", &[][..], "no MCAP recording"),
        ("head.mcap", &bytes[..60], "lacks"),
    ] {
        let path = again.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        refused(
            boresight().arg("diff").args([&path, &path]),
            &[name, wanted],
        );
        refused(boresight().arg("run").arg(&path), &[name, wanted]);
    }
    refused(
        boresight().args(["diff", "a.mcap", "b.mcap", "--tolerance", "x"]),
        &["--tolerance x", "FIELD=MOST"],
    );
}

/// A sweep over power and seeds of half a second each.
const SWEEP: &str = "name = 'power'\nscenario = 'demo.toml'\nset = ['detector.kind=truth']\nseeds = '1..=3'\n\
    keep = ['outcome', 'energy_j', 'time_to_acquire_s', 'time_to_neutralise_s']\n\
    [[factors]]\nname = 'power'\nkey = 'station.laser.power_w'\nvalues = [500.0, 1000.0]\n\
    [[factors]]\nname = 'noise'\nlevels = [{ name = 'none', set = ['detector.truth.noise_px=0'] }, \
    { name = 'some', set = ['detector.truth.noise_px=1'] }]\n";

fn sweep(experiment: &Path, out: &Path, more: &[&str]) -> Output {
    let mut command = boresight();
    command.arg("sweep").arg(experiment).arg("--out").arg(out);
    command.args(more).output().unwrap()
}

#[test]
fn a_sweeps_table_depends_on_neither_cores_nor_order_nor_kills() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    expecting(folder.path(), "demo", "outcome = 'tracked'");
    let demo = std::fs::read_to_string(path("demo.toml")).unwrap();
    let short = demo.replace("duration_s = 2.0", "duration_s = 0.5");
    std::fs::write(path("demo.toml"), short).unwrap();
    let experiment = path("sweep.toml");
    std::fs::write(&experiment, SWEEP).unwrap();
    let table = |out: &str| {
        let parquet = std::fs::read(path(out).join("table.parquet")).unwrap();
        let csv = std::fs::read_to_string(path(out).join("table.csv")).unwrap();
        (parquet, csv)
    };
    let made = |output: Output| assert!(output.status.success(), "{}", stderr(&output));
    made(sweep(&experiment, &path("one"), &["--jobs", "1"]));
    made(sweep(&experiment, &path("two"), &["--jobs", "3"]));
    let whole = table("one");
    assert_eq!(whole, table("two"));
    let lines: Vec<&str> = whole.1.lines().collect();
    assert_eq!(lines.len(), 13);
    assert!(
        lines[0].starts_with("run,power,noise,seed,outcome,energy_j,"),
        "{}",
        lines[0]
    );
    assert!(lines[1].starts_with("0,500,none,1,"), "{}", lines[1]);
    let page = std::fs::read_to_string(path("one").join("sweep.html")).unwrap();
    assert!(page.contains("12 runs, 0 failed") && page.contains("boresight run "));

    // Killed while it wrote its sixth run: that half line goes, the rest is not made again.
    let journal = path("two").join("runs-all.jsonl");
    let text = std::fs::read_to_string(&journal).unwrap();
    let kept: usize = text.split_inclusive('\n').take(6).map(str::len).sum();
    std::fs::write(&journal, &text[..kept + 20]).unwrap();
    let output = sweep(&experiment, &path("two"), &[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("12 runs, 5 of them made before"), "{said}");
    assert_eq!(whole, table("two"));

    // Killed three times, each after as many runs as its own pace brought: the same table.
    let lines = || {
        std::fs::read(path("killed").join("runs-all.jsonl")).map_or(0, |journal| {
            journal.iter().filter(|byte| **byte == b'\n').count()
        })
    };
    for more in [2, 3, 4] {
        let wanted = lines() + more;
        let mut command = boresight();
        let mut running = command
            .arg("sweep")
            .arg(&experiment)
            .arg("--out")
            .arg(path("killed"))
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        while lines() < wanted && running.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(3));
        }
        running.kill().unwrap();
        running.wait().unwrap();
    }
    assert!((6..=14).contains(&lines()), "{}", lines());
    made(sweep(&experiment, &path("killed"), &[]));
    assert_eq!(whole, table("killed"));

    // In shards, put together; not before all are there.
    made(sweep(&experiment, &path("parts"), &["--shard", "2/2"]));
    let early = sweep(&experiment, &path("parts"), &["--merge"]);
    assert_eq!(early.status.code(), Some(2));
    assert!(
        stderr(&early).contains("6 of 12 runs"),
        "{}",
        stderr(&early)
    );
    made(sweep(&experiment, &path("parts"), &["--shard", "1/2"]));
    made(sweep(&experiment, &path("parts"), &["--merge"]));
    assert_eq!(whole, table("parts"));

    if let Some(python) = std::env::var_os("BORESIGHT_PYTHON") {
        let script = Path::new(ROOT).join("tests/read_table.py");
        let output = Command::new(python)
            .arg(script)
            .arg(path("one"))
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{text}{}", stderr(&output));
        assert!(text.contains("12 rows"), "{text}");
    } else {
        println!("SKIP: BORESIGHT_PYTHON is not set; ./test sets it");
    }

    // On a cluster of three nodes, of which one is killed midway.
    let ray = std::env::var_os("BORESIGHT_PYTHON").filter(|python| {
        let output = Command::new(python).args(["-c", "import ray"]).output();
        output.is_ok_and(|output| output.status.success())
    });
    if let Some(python) = ray {
        let output = Command::new(python)
            .arg(Path::new(ROOT).join("python/tests/cluster.py"))
            .arg(env!("CARGO_BIN_EXE_boresight"))
            .args(["sweep.toml", "one"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{text}{}", stderr(&output));
        assert!(text.contains("same table"), "{text}");
    } else {
        println!("SKIP: no Python with ray; ./test installs it");
    }

    // More seeds and values: what there is stays, the rest is made, and the table is that of all at once.
    let other = path("other.toml");
    let more = SWEEP
        .replace("'1..=3'", "'1..=4'")
        .replace("[500.0,", "[250.0, 500.0,");
    std::fs::write(&other, more).unwrap();
    let output = sweep(&other, &path("one"), &[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("24 runs, 12 of them made before"), "{said}");
    made(sweep(&other, &path("all"), &[]));
    assert_eq!(table("one"), table("all"));

    // Another experiment does not go on in the folder of this one.
    std::fs::write(&other, SWEEP.replace("'energy_j', ", "")).unwrap();
    let output = sweep(&other, &path("one"), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("of another scenario"),
        "{}",
        stderr(&output)
    );
    // A run that fails is kept apart: a station inside a building.
    let inside = SWEEP.replace(
        "{ name = 'none', set = ['detector.truth.noise_px=0'] }",
        "{ name = 'none', set = ['station.position_enu_m=[0, 0, -5]'] }",
    );
    std::fs::write(&other, inside).unwrap();
    let output = sweep(&other, &path("failing"), &[]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    // Made again the next time, and all others are not.
    let output = sweep(&other, &path("failing"), &[]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        said.contains("12 runs, 6 of them made before, 6 failed"),
        "{said}"
    );
    let failed = std::fs::read_to_string(path("failing").join("failed.csv")).unwrap();
    assert_eq!(failed.lines().count(), 7, "{failed}");
    assert!(
        failed.contains("put it above") && failed.contains("boresight run "),
        "{failed}"
    );
    assert_eq!(table("failing").1.lines().count(), 7);
    for (from, to, wanted) in [
        ("laser.power_w", "laser.powr_w", "power_w"),
        ("[500.0, 1000.0]", "['much']", "factors[0]"),
        (
            "values = [500.0, 1000.0]",
            "range = [1, 2]\nsteps = 1000000000",
            "must be from 1 to 1000000",
        ),
        ("demo.toml", "nowhere.toml", "nowhere.toml"),
        ("seeds =", "sedes =", "did you mean 'seeds'"),
        (
            "set = ['detector.kind=truth']\n",
            "set = ['detector.kind=onnx']\n",
            "pictures: detector.kind",
        ),
    ] {
        std::fs::write(&other, SWEEP.replace(from, to)).unwrap();
        let mut command = boresight();
        command
            .arg("sweep")
            .arg(&other)
            .arg("--out")
            .arg(path("refused"));
        refused(&mut command, &[wanted]);
    }
}

/// The blocks of a Markdown text in a language.
fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    let fence = format!("```{language}\n");
    let parts = text.split(&fence[..]).skip(1);
    parts
        .map(|part| part.split("```").next().unwrap())
        .collect()
}

#[test]
fn the_tutorial_can_be_followed() {
    let text = std::fs::read_to_string(Path::new(ROOT).join("docs/tutorial.md")).unwrap();
    let folder = TempDir::new().unwrap();
    for name in ["scenarios", "assets"] {
        std::os::unix::fs::symlink(Path::new(ROOT).join(name), folder.path().join(name)).unwrap();
    }
    for (name, block) in ["mine.toml", "sweep.toml"]
        .iter()
        .zip(blocks(&text, "toml"))
    {
        std::fs::write(folder.path().join(name), block).unwrap();
    }
    let commands: Vec<&str> = (blocks(&text, "sh").into_iter().flat_map(str::lines))
        .filter_map(|line| line.strip_prefix("boresight "))
        .collect();
    assert!(commands.len() >= 7, "{commands:?}");
    for command in commands {
        let mut run = boresight();
        if command.starts_with("view ") {
            // A user closes the window; here a picture of it ends the command.
            run = on_display();
            run.args(command.split_whitespace());
            run.args(["--screenshot", "out/window.png", "1"]);
        } else {
            run.args(command.split_whitespace());
        }
        let output = run.current_dir(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success(),
            "{command}: {said}{}",
            stderr(&output)
        );
    }
    for file in [
        "out/demo/report.html",
        "out/mine/sweep.html",
        "out/second.mp4",
    ] {
        assert!(folder.path().join(file).exists(), "{file}");
    }
    // What it says of a wrong expectation is so.
    let mine = folder.path().join("mine.toml");
    let wrong = std::fs::read_to_string(&mine).unwrap();
    std::fs::write(&mine, wrong.replace("at_most = 0 }", "at_most = -1 }")).unwrap();
    assert_eq!(test(&mine, &[]).0, 1);
}
