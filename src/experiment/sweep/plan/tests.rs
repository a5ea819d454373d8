use super::*;
use std::collections::BTreeSet;

fn plan(text: &str) -> Result<Plan, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("experiment.toml");
    let scenario = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/scenarios/urban_intercept.toml"
    );
    let head = format!("name = 'x'\nscenario = '{scenario}'\nset = ['detector.kind=truth']\n");
    std::fs::write(&path, head + text).unwrap();
    Plan::read(&path).map_err(|error| error.to_string())
}

#[test]
fn the_shipped_experiments_can_be_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments");
    let mut read = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let plan = Plan::read(&path);
        assert!(plan.is_ok(), "{}: {:?}", path.display(), plan.err());
        read += 1;
    }
    assert!(read >= 5);
}

#[test]
fn whole_numbers_are_as_likely_as_each_other() {
    let text = "sampling = 'latin_hypercube'\nsamples = 300\n[[factors]]\nkey = 'detector.roi_px'\n\
                range = [16, 18]\nwhole = true\n";
    let plan = plan(text).unwrap();
    let mut counts = [0; 3];
    for index in 0..plan.runs() {
        let number = plan.run(index).settings[0].number.unwrap();
        counts[number as usize - 16] += 1;
    }
    assert_eq!(counts, [100; 3]);
}

#[test]
fn runs_of_a_changed_model_are_others() {
    let folder = tempfile::tempdir().unwrap();
    let uav = folder.path().join("own.toml");
    let text = format!(
        "[[factors]]\nkey = 'uavs.0.model'\nvalues = ['fpv5', '{}']\n",
        uav.display()
    );
    let keys = |content: &str| {
        std::fs::write(&uav, content).unwrap();
        let plan = plan(&text).unwrap();
        (plan.key(&plan.run(0)), plan.key(&plan.run(1)))
    };
    let [one, same, other] = ["a", "a", "b"].map(keys);
    assert!(one == same && one.0 == other.0 && one.1 != other.1);
}

#[test]
fn more_seeds_and_values_keep_the_runs_that_there_are() {
    let keys = |text: &str| {
        let plan = plan(text).unwrap();
        let keys: Vec<String> = (0..plan.runs())
            .map(|index| plan.key(&plan.run(index)))
            .collect();
        (plan.hash, keys)
    };
    let text = |seeds: &str, values: &str| {
        format!("seeds = {seeds}\n[[factors]]\nkey = 'station.laser.power_w'\nvalues = {values}\n")
    };
    let (hash, few) = keys(&text("'1..=2'", "[100.0, 400.0]"));
    let (same, many) = keys(&text("'0..=2'", "[200.0, 100.0, 400.0]"));
    assert_eq!(hash, same);
    assert!(few.iter().all(|key| many.contains(key)));
    assert_eq!(BTreeSet::from_iter(&many).len(), 9);
    // Other figures are kept: no run has them yet.
    let (other, _) = keys(&format!(
        "keep = ['dwell_s']\n{}",
        text("'1..=2'", "[100.0]")
    ));
    assert_ne!(hash, other);
}

const POWER: &str = "[[factors]]\nkey = 'station.laser.power_w'\nrange = [100.0, 1600.0]\n";

#[test]
fn a_grid_takes_every_combination() {
    let text = format!(
        "seeds = '1..=2'\n{POWER}steps = 3\nlog = true\n\
         [[factors]]\nname = 'light'\nlevels = [{{ name = 'day', set = [] }}, \
         {{ name = 'dusk', set = ['time_utc=2025-09-20T18:00:00Z'] }}]\n"
    );
    let plan = plan(&text).unwrap();
    assert_eq!(plan.runs(), 12);
    let labels: Vec<String> = (0..12)
        .map(|index| {
            let run = plan.run(index);
            let labels: Vec<_> = run.settings.iter().map(|s| s.label.clone()).collect();
            format!("{} {}", labels.join(" "), run.seed)
        })
        .collect();
    assert_eq!(labels[0], "100.0 day 1");
    assert_eq!(labels[1], "100.0 day 2");
    assert_eq!(labels[2], "100.0 dusk 1");
    assert!(labels[4].starts_with("400"), "{}", labels[4]);
    assert_eq!(labels[11], "1600.0 dusk 2");
    let loaded = plan.scenario(&plan.run(11)).unwrap();
    assert_eq!(loaded.scenario.station.laser.power_w, 1600.0);
    assert!(
        plan.command(&plan.run(11))
            .contains("--set station.laser.power_w=1600.0")
    );
}

#[test]
fn samples_fill_the_range() {
    for sampling in ["latin_hypercube", "sobol"] {
        let text = format!("sampling = '{sampling}'\nsamples = 64\n{POWER}");
        let plan = plan(&text).unwrap();
        let mut values: Vec<f64> = (0..plan.runs())
            .map(|index| plan.run(index).settings[0].number.unwrap())
            .collect();
        values.sort_by(f64::total_cmp);
        // One in each of 64 strata; 64 points of a scrambled Sobol sequence have that too.
        for (stratum, value) in values.iter().enumerate() {
            let u = (value - 100.0) / 1500.0 * 64.0;
            let within = (stratum as f64..=stratum as f64 + 1.0).contains(&u);
            assert!(within, "{sampling}: {u} in {stratum}");
        }
    }
}

#[test]
fn what_cannot_be_run_is_refused() {
    for (text, wanted) in [
        ("", "missing"),
        (
            "[[factors]]\nkey = 'station.laser.powr_w'\nvalues = [1]\n",
            "power_w",
        ),
        (
            "[[factors]]\nkey = 'station.laser.power_w'\nvalues = ['much']\n",
            "factors[0]",
        ),
        (
            "[[factors]]\nkey = 'seed'\n",
            "one of values, range and levels",
        ),
        (
            "[[factors]]\nkey = 'detector.roi_px'\nvalues = [16]\nrange = [16, 18]\nsteps = 2\n",
            "found 2",
        ),
        (&format!("{POWER}steps = 1\n"), "at least 2 steps"),
        (
            &format!(
                "{POWER}steps = 1000000\n[[factors]]\nkey = 'duration_s'\nrange = [1, 2]\nsteps = 1000\n"
            ),
            "1000000000 runs",
        ),
        (&format!("samples = 3\n{POWER}steps = 2\n"), "leave it out"),
        (&format!("sampling = 'sobol'\n{POWER}"), "samples"),
        (
            &format!("keep = ['dwel_s']\n{POWER}steps = 2\n"),
            "did you mean 'dwell_s'",
        ),
        (
            &format!("{POWER}steps = 2\n{POWER}steps = 2\n"),
            "taken by an earlier factor",
        ),
        (
            "[[factors]]\nkey = 'station.laser.power_w'\nrange = [2, 1]\nsteps = 2\n",
            "below the second",
        ),
        (
            &format!("sampling = 'sobol'\nsamples = 65537\n{POWER}"),
            "65536 points",
        ),
        (
            &format!(
                "sampling = 'sobol'\nsamples = 2\n{}",
                (0..257)
                    .map(|n| POWER.replace("key", &format!("name = 'f{n}'\nkey")))
                    .collect::<String>()
            ),
            "256 dimensions",
        ),
        ("[[factors]]\nkey = 'seed'\nvalues = [1, 2]\n", "with seeds"),
        (
            "[[factors]]\nname = 'x'\nlevels = [{ name = 'a', set = ['seed=3'] }]\n",
            "with seeds",
        ),
        (&format!("seeds = []\n{POWER}steps = 2\n"), "found 0 seeds"),
        (
            &format!("seeds = [4, 4]\n{POWER}steps = 2\n"),
            "holds 4 twice",
        ),
        (
            "[[factors]]\nkey = 'station.laser.power_w'\nvalues = [1, 2, 1]\n",
            "'1' twice",
        ),
        (
            "[[factors]]\nkey = 'detector.roi_px'\nrange = [16, 18]\nsteps = 5\nwhole = true\n",
            "'17' twice",
        ),
        (
            "[[factors]]\nkey = 'detector.roi_px'\nrange = [16.5, 18]\nsteps = 2\nwhole = true\n",
            "whole ends",
        ),
        (
            &format!("keep = ['dwell_s', 'dwell_s']\n{POWER}steps = 2\n"),
            "column 'dwell_s' already",
        ),
        (
            &format!("keep = ['seed']\n{POWER}steps = 2\n"),
            "column 'seed' already",
        ),
        (
            &format!("keep = ['real_time_factor']\n{POWER}steps = 2\n"),
            "wall-clock",
        ),
        (
            "[[factors]]\nkey = 'detector.kind'\nvalues = ['truth', 'onnx']\n",
            "kind = onnx: detector.kind = \"onnx\" needs pictures",
        ),
    ] {
        let message = plan(text).unwrap_err();
        assert!(message.contains(wanted), "{text}: {message}");
        assert!(!message.contains('\n'), "{message}");
    }
}
