//! `boresight new`: a commented scenario to start from.

use crate::output::{self, OutputError};
use crate::place::located;
use crate::scenario::{self, InputError};
use clap::Args;
use std::path::{Path, PathBuf};

/// The scenario that is written where no other is named.
const TEMPLATE: &str = include_str!("../assets/new.toml");
/// The schema's file, beside the scenario.
const SCHEMA: &str = "scenarios.schema.json";

/// What `boresight new` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Name of the scenario, which is written to NAME.toml here, or a path that ends in .toml.
    #[arg(default_value = "scenario")]
    name: PathBuf,
    /// Begin with this scenario: the name of a shipped one, such as `two_stations`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    from: Option<PathBuf>,
}

/// Why no scenario is written.
#[derive(Debug, thiserror::Error)]
pub enum NewError {
    /// A file that is there already.
    #[error("{}: is there already; choose another name, or remove it", .0.display())]
    Exists(PathBuf),
    /// A path without a name.
    #[error("{}: names no scenario; give a name such as mine, or a path such as mine.toml", .0.display())]
    Nameless(PathBuf),
    /// A scenario to begin with that cannot be used.
    #[error(transparent)]
    From(#[from] InputError),
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Writes the scenario and, beside it, the schema by which an editor completes it; their paths.
pub fn new(arguments: &Arguments) -> Result<[PathBuf; 2], NewError> {
    let path = with_ending(&arguments.name);
    let name = path.file_stem().and_then(|stem| stem.to_str());
    let name = name.filter(|name| !name.trim().is_empty());
    let name = name.ok_or_else(|| NewError::Nameless(arguments.name.clone()))?;
    if path.exists() {
        return Err(NewError::Exists(path));
    }
    let text = match &arguments.from {
        None => TEMPLATE.to_owned(),
        Some(from) => begun_with(from)?,
    };
    output::put(&path, named(&text, name))?;
    let schema = path.with_file_name(SCHEMA);
    output::put(&schema, scenario::json_schema())?;
    Ok([path, schema])
}

fn with_ending(name: &Path) -> PathBuf {
    match name.extension().is_some_and(|end| end == "toml") {
        true => name.to_owned(),
        false => {
            let mut whole = name.as_os_str().to_owned();
            whole.push(".toml");
            whole.into()
        }
    }
}

/// The text of a shipped scenario or of a file, which must be a right one.
fn begun_with(from: &Path) -> Result<String, InputError> {
    let shipped = Path::new("scenarios").join(with_ending(from));
    let at = match from.is_file() {
        true => from.to_owned(),
        false => crate::data::found(&shipped),
    };
    let at = if at.exists() { at } else { from.to_owned() };
    let mut loaded = scenario::Scenario::load(&at, &[])?;
    let folder = loaded.path.parent().unwrap_or(Path::new("."));
    let folder = folder.canonicalize().unwrap_or(folder.to_owned());
    // What it names is found from the new file, too.
    let mut text = loaded.source;
    for path in loaded.scenario.paths_mut() {
        let whole = toml::Value::String(located(&folder, path)).to_string();
        for quote in ['"', '\''] {
            text = text.replace(&format!("{quote}{path}{quote}"), &whole);
        }
    }
    Ok(text)
}

/// The text with another name, and the line by which editors find the schema.
fn named(text: &str, name: &str) -> String {
    let mut new = format!("#:schema ./{SCHEMA}\n");
    let mut done = false;
    for line in text.lines().filter(|line| !line.starts_with("#:schema")) {
        let key = line.split('=').next().unwrap_or_default().trim();
        match key == "name" && !done {
            // Quoted as TOML has it.
            true => new += &format!("name = {}\n", toml::Value::String(name.to_owned())),
            false => {
                new += line;
                new.push('\n');
            }
        }
        done |= key == "name";
    }
    new
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(name: &Path, from: Option<&str>) -> Result<[PathBuf; 2], NewError> {
        new(&Arguments {
            name: name.to_owned(),
            from: from.map(PathBuf::from),
        })
    }

    #[test]
    fn a_scenario_and_its_schema_are_written_once() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("mine \"x\"");
        let [path, schema] = written(&name, None).unwrap();
        assert_eq!(path, folder.path().join("mine \"x\".toml"));
        let loaded = scenario::Scenario::load(&path, &[]).unwrap();
        assert_eq!(loaded.scenario.name, "mine \"x\"");
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("#:schema ./scenarios.schema.json\n"));
        let schema = std::fs::read_to_string(schema).unwrap();
        assert_eq!(schema, scenario::json_schema());
        let again = written(&name, None).unwrap_err().to_string();
        assert!(
            again.ends_with("is there already; choose another name, or remove it"),
            "{again}"
        );
    }

    #[test]
    fn a_shipped_scenario_or_a_file_is_begun_with() {
        let folder = tempfile::tempdir().unwrap();
        let [path, _] = written(&folder.path().join("a.toml"), Some("raid")).unwrap();
        let own = scenario::Scenario::load(&path, &[]).unwrap().scenario;
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/raid.toml");
        let mut raid = scenario::Scenario::load(&shipped, &[]).unwrap().scenario;
        assert_eq!(own.name, "a");
        raid.name = "a".into();
        assert_eq!(own, raid);
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text.matches("#:schema").count(), 1);
        // From a file that has the line already.
        let from = path.to_str().unwrap();
        let [path, _] = written(&folder.path().join("b"), Some(from)).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        assert_eq!(text.matches("#:schema").count(), 1);
        // Files that the other one names are found from the new one.
        let other = folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        let files = "[city]\nsources = ['a.geojson', { file = \"b.tif\", terrain = \"c.tif\" }]\n";
        let own = TEMPLATE.replace("[city]\nseed = 1\nextent_m = 1_600.0\n", files);
        assert!(own.contains("b.tif"));
        let own = format!("#:schema ../x.json\n{own}");
        std::fs::write(other.join("own.toml"), own).unwrap();
        let from = other.join("own.toml");
        let [path, _] = written(&folder.path().join("d"), from.to_str()).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("#:schema ./scenarios.schema.json\n") && !text.contains("x.json"));
        let mut own = scenario::Scenario::load(&path, &[]).unwrap().scenario;
        let other = other.canonicalize().unwrap();
        for path in own.paths_mut() {
            assert_eq!(Path::new(path).parent(), Some(&*other), "{path}");
        }
        let absent = written(&folder.path().join("c"), Some("absent")).unwrap_err();
        assert!(
            absent.to_string().starts_with("absent: cannot be read"),
            "{absent}"
        );
        assert!(!folder.path().join("c.toml").exists());
    }
}
