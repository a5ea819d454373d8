//! `cargo xtask`: what a developer does here, by name.

mod book;
mod figures;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Why a task could not be done, in a line.
pub type Fault = String;

/// A task: its name, what it takes, what it is for.
type Task = (&'static str, &'static str, &'static str);

const TASKS: [Task; 9] = [
    (
        "test",
        "CRATE",
        "tests one crate without the engine: models, scenario, geodata, recording, inference, common, validate",
    ),
    (
        "reference",
        "",
        "writes docs/scenarios.md and its schema anew, from the doc comments",
    ),
    (
        "stubs",
        "",
        "writes python/boresight/_boresight.pyi anew, from the types and doc comments of crates/python",
    ),
    (
        "book",
        "",
        "builds the documents as a book in out/book and checks its links",
    ),
    (
        "figures",
        "",
        "writes the values of docs/figures.toml into the pages that quote them",
    ),
    (
        "stale",
        "",
        "lists published figures that are older than the last change to what they depend on",
    ),
    (
        "pictures",
        "",
        "lists the documents' pictures and the commands that make them",
    ),
    (
        "peers",
        "",
        "measures Boresight beside its peers (benches/peers)",
    ),
    ("bench", "[FILTER]", "runs the benches"),
];

/// The repository's root.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here).to_owned()
}

/// Runs a program in the repository's root.
fn run(program: &str, arguments: &[&str]) -> Result<(), Fault> {
    run_in(&root(), program, arguments)
}

/// Runs a program in a folder.
fn run_in(folder: &Path, program: &str, arguments: &[&str]) -> Result<(), Fault> {
    let said = format!("{program} {}", arguments.join(" "));
    eprintln!("{said}");
    let mut command = Command::new(program);
    let status = command.args(arguments).current_dir(folder).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{said}: {status}")),
        Err(error) => Err(format!("{said}: {error}; is it installed?")),
    }
}

/// Writes the stubs of the Python module anew.
fn stubs() -> Result<(), Fault> {
    // maturin reads them from the library's symbols, which the release profile leaves out.
    let words = "generate-stubs --profile release --out ../out/stubs -- -C strip=none";
    let words: Vec<_> = words.split(' ').collect();
    let package = root().join("python");
    run_in(&package, "maturin", &words)
        .map_err(|why| format!("{why}; `pip install maturin` has it"))?;
    let [from, to] = ["../out/stubs/boresight", "boresight"].map(|folder| package.join(folder));
    let name = "_boresight.pyi";
    std::fs::copy(from.join(name), to.join(name))
        .map(drop)
        .map_err(|error| format!("{name}: {error}"))
}

fn list() {
    println!("cargo xtask TASK\n");
    for (name, takes, what) in TASKS {
        println!("  {:18} {what}", format!("{name} {takes}"));
    }
    println!("\n./test is what every change must pass.");
}

fn task(name: &str, rest: &[String]) -> Result<(), Fault> {
    let cargo = |arguments: &[&str]| run("cargo", arguments);
    match (name, rest) {
        ("test", [one]) => cargo(&["test", "--release", "-p", &format!("boresight-{one}")]),
        ("reference", []) => cargo(&["run", "--release", "--locked", "--", "schema"]),
        ("stubs", []) => stubs(),
        ("book", []) => book::build(),
        ("figures", []) => figures::write(),
        ("stale", []) => figures::stale(),
        ("pictures", []) => figures::pictures(),
        ("peers", []) => run("benches/peers/run", &[]),
        ("bench", []) => cargo(&["bench", "--locked"]),
        ("bench", [filter]) => cargo(&["bench", "--locked", "--", filter]),
        _ => {
            list();
            Err(format!(
                "no task '{name}' that takes this; the list above has them all"
            ))
        }
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((name, rest)) = arguments.split_first() else {
        list();
        return ExitCode::SUCCESS;
    };
    match task(name, rest) {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("error: {fault}");
            ExitCode::FAILURE
        }
    }
}
