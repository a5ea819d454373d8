//! `boresight test`: holds scenarios to their `[expect]`, as test runners do.

use super::ExperimentError;
use super::figures::{Kind, figure, kind};
use super::runner::{Runner, Unmade};
use crate::data;
use crate::models::maths::statistics::least_share;
use crate::output::{self, OutputError, put, put_json, writable};
use crate::parallel::threads;
use crate::scenario::{Bound, Expect, InputError, Loaded, Never, Scenario};
use crate::stop;
use clap::Args;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// What `boresight test` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Scenario files, and folders that hold some.
    #[arg(default_value = "scenarios")]
    pub paths: Vec<PathBuf>,
    /// Runs at a time; by default one a core. It changes no result.
    #[arg(long)]
    pub jobs: Option<NonZeroUsize>,
    /// Write the state hashes of these runs into the scenarios.
    #[arg(long)]
    pub bless: bool,
    /// Write the results as JUnit XML.
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// How it went for a scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All that it expects is so.
    Met,
    /// Something is not.
    NotMet,
    /// It expects nothing.
    NothingExpected,
    /// It cannot be run.
    BadInput,
    /// The command was stopped before its runs were made.
    Stopped,
}

/// What became of a scenario.
#[derive(Clone, Debug, Serialize)]
pub struct Tested {
    /// The file.
    pub path: PathBuf,
    /// How it went.
    pub verdict: Verdict,
    /// Runs made.
    pub runs: usize,
    /// What was not met, or is wrong with the file: one sentence each.
    pub reasons: Vec<String>,
    /// Wall-clock time of its runs, added up \[s\].
    pub elapsed_s: f64,
}

/// Wall-clock time in words: tenths of a second, whole seconds from a hundred on.
fn seconds(elapsed_s: f64) -> String {
    match elapsed_s < 100.0 {
        true => format!("{elapsed_s:.1} s"),
        false => format!("{elapsed_s:.0} s"),
    }
}

/// What became of all.
#[derive(Clone, Debug, Serialize)]
pub struct Tests {
    /// Version of the program.
    pub version: &'static str,
    /// The platform, as `state_hash` names it.
    pub platform: String,
    /// The scenarios in the order of their paths.
    pub scenarios: Vec<Tested>,
    /// Wall-clock time of all \[s\].
    pub elapsed_s: f64,
}

impl Tests {
    fn count(&self, verdict: Verdict) -> usize {
        let of = |tested: &&Tested| tested.verdict == verdict;
        self.scenarios.iter().filter(of).count()
    }

    /// 0 where all is met, 1 where something is not, 2 where a scenario cannot be run.
    pub fn exit_code(&self) -> u8 {
        match (self.count(Verdict::BadInput), self.count(Verdict::NotMet)) {
            (0, 0) => 0,
            (0, _) => 1,
            _ => 2,
        }
    }

    /// One line on all.
    pub fn text(&self) -> String {
        let [met, not_met] = [Verdict::Met, Verdict::NotMet].map(|verdict| self.count(verdict));
        let mut text = format!("{met} met, {not_met} not met");
        for (verdict, what) in [
            (Verdict::NothingExpected, "without [expect]"),
            (Verdict::BadInput, "cannot be run"),
            (Verdict::Stopped, "stopped"),
        ] {
            let count = self.count(verdict);
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        let runs: usize = self.scenarios.iter().map(|tested| tested.runs).sum();
        let plural = if runs == 1 { "" } else { "s" };
        text += &format!("  ({runs} run{plural}, {})", seconds(self.elapsed_s));
        if let Some(said) = stop::said("the same command makes all runs again") {
            text += &format!("\n{said}");
        }
        text
    }

    /// The results as JUnit's XML.
    fn junit(&self) -> Report {
        let mut suite = TestSuite::new("boresight test");
        for tested in &self.scenarios {
            let mut status = match tested.verdict {
                Verdict::Met => TestCaseStatus::success(),
                Verdict::NotMet => TestCaseStatus::non_success(NonSuccessKind::Failure),
                Verdict::BadInput => TestCaseStatus::non_success(NonSuccessKind::Error),
                Verdict::NothingExpected | Verdict::Stopped => TestCaseStatus::skipped(),
            };
            match tested.verdict {
                Verdict::NotMet => status.set_type("not met"),
                Verdict::BadInput => status.set_type("cannot be run"),
                Verdict::Stopped => status.set_type("stopped"),
                Verdict::Met | Verdict::NothingExpected => &mut status,
            };
            if !tested.reasons.is_empty() {
                status.set_message(tested.reasons.join("; "));
            }
            // Runners group by the class, which is the folder here.
            let folder = (tested.path.parent())
                .filter(|folder| !folder.as_os_str().is_empty())
                .unwrap_or(Path::new("."));
            let mut case = TestCase::new(tested.path.display().to_string(), status);
            case.set_classname(folder.display().to_string());
            case.set_time(Duration::from_secs_f64(tested.elapsed_s));
            suite.add_test_case(case);
        }
        let elapsed_s = self.scenarios.iter().map(|tested| tested.elapsed_s).sum();
        let elapsed = Duration::from_secs_f64(elapsed_s);
        suite.set_time(elapsed);
        let mut report = Report::new("boresight");
        report.set_time(elapsed);
        report.add_test_suite(suite);
        report
    }
}

/// The platform, as `state_hash` names it.
pub fn platform() -> String {
    use std::env::consts::{ARCH, OS};
    format!("{ARCH}-{OS}")
}

/// Tests every scenario, says of each how it went once its runs are over, and writes what is asked for.
pub fn test(arguments: &Arguments) -> Result<Tests, ExperimentError> {
    let started = Instant::now();
    let files = [("--json", &arguments.json), ("--junit", &arguments.junit)];
    for (option, path) in files {
        if let Some(path) = path {
            writable(path).map_err(|error| unwritable(option, path, error))?;
        }
    }
    let (mut paths, mut met) = (Vec::new(), BTreeMap::new());
    for path in &arguments.paths {
        let path = &data::found(path);
        if !scenarios_below(path, &mut paths, &mut met)? {
            return Err(ExperimentError::Path {
                path: path.into(),
                what: "holds no scenario (*.toml); name a scenario or a folder with some".into(),
            });
        }
    }
    let read = |path| Case::read(path, arguments.bless);
    let cases: Vec<Case> = paths.into_iter().map(read).collect();
    // What renders does so one at a time: one thread begins with that, the others with the rest.
    let queues = [false, true].map(|blind| {
        let mut runs: Vec<(usize, u64)> = Vec::new();
        for (index, case) in cases.iter().enumerate() {
            if let Some(plan) = case
                .plan
                .as_ref()
                .filter(|plan| plan.expected.blind == blind)
            {
                runs.extend(plan.seeds.iter().map(|seed| (index, *seed)));
            }
        }
        (runs, AtomicUsize::new(0))
    });
    for case in cases.iter().filter(|case| case.plan.is_none()) {
        case.say();
    }
    let runner = Runner::default();
    let work = |thread: usize| {
        let order = if thread == 0 { [0, 1] } else { [1, 0] };
        for (runs, next) in order.map(|queue| &queues[queue]) {
            while let Some((case, seed)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                cases[*case].run(*seed, &runner);
            }
        }
    };
    std::thread::scope(|scope| {
        for thread in 0..threads(arguments.jobs) {
            scope.spawn(move || work(thread));
        }
    });
    if stop::asked().is_some() {
        // The others have said how they went.
        cases
            .iter()
            .filter(|case| case.is_stopped())
            .for_each(Case::say);
    }
    let tests = Tests {
        version: crate::VERSION,
        platform: platform(),
        scenarios: cases.into_iter().map(Case::tested).collect(),
        elapsed_s: started.elapsed().as_secs_f64(),
    };
    if let Some(path) = &arguments.json {
        put_json(path, &tests).map_err(|error| unwritable("--json", path, error))?;
    }
    if let Some(path) = &arguments.junit {
        let xml = tests.junit().to_string();
        let xml = xml.map_err(|error| ExperimentError::Text {
            path: path.into(),
            message: error.to_string(),
        })?;
        put(path, xml).map_err(|error| unwritable("--junit", path, error))?;
    }
    Ok(tests)
}

/// The error of a file that was asked for by an option.
fn unwritable(option: &str, path: &Path, error: OutputError) -> ExperimentError {
    let why = match error {
        OutputError::Folder { source, .. } | OutputError::File { source, .. } => source.to_string(),
        OutputError::Json { source, .. } => source.to_string(),
    };
    ExperimentError::Path {
        path: path.into(),
        what: format!("cannot be written: {why}; name another file with {option}"),
    }
}

/// Finds the scenario files of a path: itself, or all TOML files below a folder, in order; each file and folder once,
/// whatever paths and links lead to it. True if there is one; `met` has what was met so far, and whether it is or holds one.
fn scenarios_below(
    path: &Path,
    found: &mut Vec<PathBuf>,
    met: &mut BTreeMap<PathBuf, bool>,
) -> Result<bool, ExperimentError> {
    let unread = |error: std::io::Error| ExperimentError::Path {
        path: path.into(),
        what: format!("cannot be read: {error}; name a scenario or a folder"),
    };
    let real = path.canonicalize().map_err(unread)?;
    if let Some(holds) = met.get(&real) {
        return Ok(*holds);
    }
    if real.is_file() {
        found.push(path.into());
        met.insert(real, true);
        return Ok(true);
    }
    // A link back up finds none there.
    met.insert(real.clone(), false);
    let entries = std::fs::read_dir(path)
        .and_then(|entries| entries.collect::<Result<Vec<_>, _>>())
        .map_err(unread)?;
    let mut entries: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    entries.sort();
    let mut holds = false;
    for entry in entries {
        let is_toml = (entry.extension()).is_some_and(|extension| extension == "toml");
        if entry.is_dir() || is_toml {
            holds |= scenarios_below(&entry, found, met)?;
        }
    }
    met.insert(real, holds);
    Ok(holds)
}

/// A scenario under test.
struct Case {
    path: PathBuf,
    /// Its runs; none where it expects nothing or cannot be read.
    plan: Option<Plan>,
    /// Whether the hash of its run is written into the file.
    bless: bool,
    found: Mutex<Found>,
}

/// The runs of a scenario.
struct Plan {
    loaded: Loaded,
    expected: Expect,
    seeds: Vec<u64>,
}

/// What was found so far.
#[derive(Default)]
struct Found {
    /// The summaries, by seed.
    summaries: BTreeMap<u64, Value>,
    /// What is wrong with the file, or with its runs, by their seeds.
    wrong: Option<String>,
    failed: BTreeMap<u64, String>,
    /// What was not met.
    not_met: Vec<String>,
    runs: usize,
    elapsed: Duration,
}

impl Found {
    /// What is wrong or not met, one sentence each.
    fn reasons(&self) -> impl Iterator<Item = &String> {
        (self.wrong.iter())
            .chain(self.failed.values())
            .chain(&self.not_met)
    }
}

impl Case {
    fn read(path: PathBuf, bless: bool) -> Self {
        let mut found = Found::default();
        let plan = Plan::read(&path, bless).unwrap_or_else(|error| {
            found.wrong = Some(error.to_string());
            None
        });
        Self {
            path,
            plan,
            bless,
            found: Mutex::new(found),
        }
    }

    /// Makes a run; after the last one, judges.
    fn run(&self, seed: u64, runner: &Runner) {
        let Some(plan) = &self.plan else {
            return;
        };
        let summary = runner.summary(&plan.loaded, seed, !plan.expected.blind);
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        match summary {
            Ok((summary, elapsed)) => {
                found.elapsed += elapsed;
                found.summaries.insert(seed, summary);
            }
            Err(Unmade::Stopped) => return,
            Err(error) => {
                found.failed.insert(seed, format!("seed {seed}: {error}"));
            }
        }
        found.runs += 1;
        if found.runs == plan.seeds.len() {
            found.not_met = plan.judge(&found.summaries);
            if self.bless
                && let Err(error) = self.bless(plan, &mut found)
            {
                found.wrong = Some(error.to_string());
            }
            drop(found);
            self.say();
        }
    }

    /// Whether some of its runs were not made.
    fn is_stopped(&self) -> bool {
        let found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        self.verdict(&found) == Verdict::Stopped
    }

    fn verdict(&self, found: &Found) -> Verdict {
        match (&found.wrong, &self.plan) {
            _ if !found.failed.is_empty() => Verdict::BadInput,
            (Some(_), _) => Verdict::BadInput,
            (None, None) => Verdict::NothingExpected,
            (None, Some(plan)) if found.runs < plan.seeds.len() => Verdict::Stopped,
            (None, Some(_)) if found.not_met.is_empty() => Verdict::Met,
            (None, Some(_)) => Verdict::NotMet,
        }
    }

    /// One line, and one more for each thing that is not as expected.
    fn say(&self) {
        let found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        let word = match self.verdict(&found) {
            Verdict::Met => "met     ",
            Verdict::NotMet => "NOT MET ",
            Verdict::NothingExpected => "-       ",
            Verdict::BadInput => "ERROR   ",
            Verdict::Stopped => "stopped ",
        };
        let mut text = format!("{word} {}", self.path.display());
        if found.runs > 0 {
            let plural = if found.runs == 1 { "" } else { "s" };
            let elapsed = seconds(found.elapsed.as_secs_f64());
            text += &format!("  ({} run{plural}, {elapsed})", found.runs);
        }
        for reason in found.reasons() {
            text += &format!("\n         {reason}");
        }
        let _ = writeln!(std::io::stdout(), "{text}");
    }

    /// Writes the hash of this platform into the file, which stays as it is otherwise.
    fn bless(&self, plan: &Plan, found: &mut Found) -> Result<(), ExperimentError> {
        let own = found.summaries.get(&plan.loaded.scenario.seed);
        let Some(hash) = own.and_then(|summary| summary["state_hash"].as_str()) else {
            return Ok(());
        };
        let mut document: toml_edit::DocumentMut =
            (plan.loaded.source.parse()).map_err(|error: toml_edit::TomlError| {
                ExperimentError::Text {
                    path: self.path.clone(),
                    message: error.to_string(),
                }
            })?;
        let expect = document["expect"].or_insert(toml_edit::table());
        let hashes =
            expect["state_hash"].or_insert(toml_edit::value(toml_edit::InlineTable::new()));
        hashes[&platform()] = toml_edit::value(hash);
        output::write(&self.path, document.to_string())?;
        found.not_met.retain(|reason| !reason.starts_with(HASH));
        Ok(())
    }

    fn tested(self) -> Tested {
        let verdict = {
            let found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
            self.verdict(&found)
        };
        let found = self
            .found
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        Tested {
            path: self.path,
            verdict,
            runs: found.runs,
            reasons: found.reasons().cloned().collect(),
            elapsed_s: found.elapsed.as_secs_f64(),
        }
    }
}

/// How the sentence on a wrong hash begins.
const HASH: &str = "state_hash";

impl Plan {
    /// The runs that a scenario asks for; `None` where it expects nothing.
    fn read(path: &Path, bless: bool) -> Result<Option<Self>, InputError> {
        let loaded = Scenario::load(path, &[])?;
        let Some(expect) = loaded.scenario.expected.clone() else {
            return Ok(None);
        };
        check(&loaded, &expect)?;
        let own = loaded.scenario.seed;
        let seeds = expect.seeds.as_ref().map_or(vec![own], |seeds| seeds.all());
        if (bless || !expect.state_hash.is_empty()) && !seeds.contains(&own) {
            let what = format!(
                "is of the scenario's seed, {own}, which is not among expect.seeds: add it there"
            );
            return Err(loaded.refuse("expect.state_hash", what));
        }
        // Every run goes by the file alone, but for the eyes of a blind one.
        let loaded = match expect.blind {
            true => Scenario::load(path, &["detector.kind=truth".into()])?,
            false => loaded,
        };
        Ok(Some(Self {
            loaded,
            expected: expect,
            seeds,
        }))
    }

    /// What is not as expected, one sentence each.
    fn judge(&self, summaries: &BTreeMap<u64, Value>) -> Vec<String> {
        let expect = &self.expected;
        let each = Run {
            outcome: expect.outcome.map(|outcome| outcome.name()),
            never: &expect.never,
            values: &expect.values,
        };
        let mut not_met = Vec::new();
        for (seed, summary) in summaries {
            let reasons = each.not_met(summary);
            not_met.extend(reasons.into_iter().map(|reason| match summaries.len() {
                1 => reason,
                _ => format!("seed {seed}: {reason}"),
            }));
        }
        for (index, share) in expect.shares.iter().enumerate() {
            let asked = Run {
                outcome: share.outcome.map(|outcome| outcome.name()),
                never: &share.never,
                values: &share.values,
            };
            let failed: Vec<u64> = (summaries.iter())
                .filter(|(_, summary)| !asked.not_met(summary).is_empty())
                .map(|(seed, _)| *seed)
                .collect();
            let (all, met) = (summaries.len(), summaries.len() - failed.len());
            let shown = match share.confidence {
                Some(confidence) => least_share(met, all, confidence),
                None => met as f64 / all.max(1) as f64,
            };
            if shown < share.at_least {
                let confidence = share.confidence.map_or(String::new(), |confidence| {
                    format!(", at least {shown:.3} with a confidence of {confidence}")
                });
                not_met.push(format!(
                    "shares[{index}]: {met} of {all} runs{confidence}, expected at least {}; not seeds {failed:?}",
                    share.at_least
                ));
            }
        }
        let own = summaries.get(&self.loaded.scenario.seed);
        if let (Some(wanted), Some(summary)) = (expect.state_hash.get(&platform()), own) {
            let hash = summary["state_hash"].as_str().unwrap_or("");
            if hash != wanted {
                not_met.push(format!("{HASH} is {hash}, expected {wanted}"));
            }
        }
        not_met
    }
}

/// Refuses bounds on figures that no run of the scenario has, of numbers on words, and of words on numbers.
pub fn check(loaded: &Loaded, expect: &Expect) -> Result<(), InputError> {
    let shares = expect.shares.iter().enumerate();
    let tables = std::iter::once(("expect".to_owned(), &expect.values))
        .chain(shares.map(|(index, share)| (format!("expect.shares[{index}]"), &share.values)));
    for (table, values) in tables {
        for (key, bound) in values {
            let refuse = |wrong: String| loaded.refuse(&format!("{table}.values"), wrong);
            let kind = kind(key, &loaded.scenario).map_err(refuse)?;
            let numbers = bound.at_least.is_some() || bound.at_most.is_some();
            match kind {
                Kind::Text if numbers => {
                    return Err(refuse(format!("'{key}' is a word: bound it with is")));
                }
                Kind::Number if bound.is.is_some() => {
                    let what = format!("'{key}' is a number: bound it with at_least and at_most");
                    return Err(refuse(what));
                }
                _ => {}
            }
        }
    }
    Ok(())
}

/// What is asked of one run.
struct Run<'a> {
    outcome: Option<&'a str>,
    never: &'a [Never],
    values: &'a BTreeMap<String, Bound>,
}

impl Run<'_> {
    /// What is not so in a run, one sentence each.
    fn not_met(&self, summary: &Value) -> Vec<String> {
        let mut reasons = Vec::new();
        let found = summary["outcome"].as_str().unwrap_or("");
        if let Some(wanted) = self.outcome.filter(|wanted| *wanted != found) {
            let why = summary["reason"].as_str().unwrap_or("");
            reasons.push(format!("outcome is {found} ({why}), expected {wanted}"));
        }
        let nothing = Bound {
            at_most: Some(0.0),
            ..Bound::default()
        };
        let never = self.never.iter().map(|never| (never.figure(), &nothing));
        let values = self.values.iter().map(|(key, bound)| (key.as_str(), bound));
        for (key, bound) in never.chain(values) {
            let value = figure(summary, key).unwrap_or_default();
            if let Some(expected) = missed(&value, bound) {
                let value = match &value {
                    Value::Null => "absent".to_owned(),
                    Value::String(text) => text.clone(),
                    other => other.to_string(),
                };
                reasons.push(format!("{key} is {value}, expected {expected}"));
            }
        }
        reasons
    }
}

/// What a figure was to be, if it is not.
fn missed(value: &Value, bound: &Bound) -> Option<String> {
    if let Some(present) = bound.present {
        if present == value.is_null() {
            return Some(if present { "present" } else { "absent" }.to_owned());
        }
        if !present {
            return None;
        }
    }
    if let Some(text) = &bound.is
        && value.as_str() != Some(text)
    {
        return Some(text.clone());
    }
    let number = value.as_f64();
    let below = |least: f64| number.is_none_or(|number| number < least);
    if let Some(least) = bound.at_least.filter(|least| below(*least)) {
        return Some(format!("at least {least}"));
    }
    let above = |most: f64| number.is_none_or(|number| number > most);
    if let Some(most) = bound.at_most.filter(|most| above(*most)) {
        return Some(format!("at most {most}"));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn bound(text: &str) -> Bound {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn bounds_are_met_or_not() {
        for (value, text, wanted) in [
            (json!(2.0), "at_most = 2", None),
            (json!(2.1), "at_most = 2", Some("at most 2")),
            (json!(2.1), "at_least = 2.2", Some("at least 2.2")),
            (json!(2.1), "at_least = 2\nat_most = 3", None),
            (json!(3), "at_least = 3", None),
            (Value::Null, "at_most = 2", Some("at most 2")),
            (Value::Null, "present = false", None),
            (json!(1.0), "present = false", Some("absent")),
            (Value::Null, "present = true", Some("present")),
            (json!("down"), "is = 'down'", None),
            (json!("flying"), "is = 'down'", Some("down")),
        ] {
            let missed = missed(&value, &bound(text));
            assert_eq!(missed.as_deref(), wanted, "{value} {text}");
        }
    }

    #[test]
    fn shares_count_over_the_runs() {
        let text = include_str!("../../scenarios/urban_intercept.toml");
        let plan = |expect: &str| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("s.toml");
            let own = text.split("[expect]").next().unwrap();
            std::fs::write(&path, format!("{own}\n[expect]\nblind = true\n{expect}")).unwrap();
            Plan::read(&path, false).map(Option::unwrap)
        };
        let run = |acquired_s: Option<f64>| json!({ "outcome": "neutralised", "time_to_acquire_s": acquired_s, "state_hash": "0" });
        // Nineteen of twenty acquire within 2 s.
        let runs: BTreeMap<u64, Value> = (1..=20)
            .map(|seed| (seed, run((seed != 7).then_some(1.5))))
            .collect();
        let share = |least: f64, confidence: &str| {
            format!(
                "seeds = '1..=20'\n[[expect.shares]]\nat_least = {least}\n{confidence}\n\
                 values.time_to_acquire_s.at_most = 2\n"
            )
        };
        assert!(plan(&share(0.95, "")).unwrap().judge(&runs).is_empty());
        let most = plan(&share(0.96, "")).unwrap().judge(&runs);
        assert!(
            most[0].contains("19 of 20") && most[0].contains("[7]"),
            "{most:?}"
        );
        // With 95 % confidence 19 of 20 show a share of 0.784 only.
        let sure = |least| {
            plan(&share(least, "confidence = 0.95"))
                .unwrap()
                .judge(&runs)
        };
        assert!(sure(0.78).is_empty());
        assert!(sure(0.79)[0].contains("0.784"), "{:?}", sure(0.79));
        // Of every run it is asked of the one that does not.
        let every = plan("seeds = '1..=20'\nvalues.time_to_acquire_s.at_most = 2\n").unwrap();
        let not_met = every.judge(&runs);
        assert_eq!(
            not_met,
            ["seed 7: time_to_acquire_s is absent, expected at most 2"]
        );
        // A hash of a seed that is not run holds nothing.
        let hash = format!(
            "seeds = '2..=3'\nstate_hash.{} = '0123456789abcdef'",
            platform()
        );
        let refused = plan(&hash).map(|_| ()).unwrap_err().to_string();
        assert!(refused.contains("expect.state_hash"), "{refused}");
    }

    #[test]
    fn expectations_that_cannot_fail_are_refused() {
        let text = include_str!("../../scenarios/urban_intercept.toml");
        let own = text.split("[expect]").next().unwrap();
        let read = |expect: &str, bless: bool| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("s.toml");
            std::fs::write(&path, format!("{own}\n[expect]\n{expect}")).unwrap();
            Plan::read(&path, bless)
                .map(|_| ())
                .map_err(|error| error.to_string())
        };
        for (expect, wanted) in [
            ("blind = true", "expects nothing"),
            ("shares = [{ at_least = 0.5 }]", "asks nothing"),
            ("values.outcome.at_most = 1", "'outcome' is a word"),
            ("values.dwell_s.is = 'long'", "'dwell_s' is a number"),
            ("values.real_time_factor.at_least = 1", "wall-clock"),
            ("seeds = [1, 2, 1]\noutcome = 'tracked'", "holds 1 twice"),
            ("seeds = []\noutcome = 'tracked'", "found 0 seeds"),
        ] {
            let message = read(expect, false).unwrap_err();
            assert!(message.contains(wanted), "{expect}: {message}");
        }
        let others = "seeds = '2..=3'\noutcome = 'tracked'";
        assert_eq!(read(others, false), Ok(()));
        assert!(read(others, true).unwrap_err().contains("add it there"));
    }

    #[test]
    fn scenarios_are_found_once_and_what_cannot_be_read_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(path("a/empty")).unwrap();
        std::fs::write(path("a/one.toml"), "").unwrap();
        std::os::unix::fs::symlink(path("a"), path("a/back")).unwrap();
        let (mut found, mut met) = (Vec::new(), BTreeMap::new());
        for name in ["a", "a/one.toml", "a/back"] {
            assert!(scenarios_below(&path(name), &mut found, &mut met).unwrap());
        }
        assert_eq!(found, [path("a/one.toml")]);
        assert!(!scenarios_below(&path("a/empty"), &mut found, &mut met).unwrap());
        std::os::unix::fs::symlink(path("gone"), path("a/gone.toml")).unwrap();
        let again = scenarios_below(&path("a"), &mut Vec::new(), &mut BTreeMap::new());
        let message = again.unwrap_err().to_string();
        assert!(
            message.contains("gone.toml") && message.contains("cannot be read"),
            "{message}"
        );
    }

    #[test]
    fn every_seed_that_failed_is_named_in_order() {
        let mut found = Found::default();
        for seed in [3, 1, 2] {
            found.failed.insert(seed, format!("seed {seed}"));
        }
        let reasons: Vec<&String> = found.reasons().collect();
        assert_eq!(reasons, ["seed 1", "seed 2", "seed 3"]);
    }
}
