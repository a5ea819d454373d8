//! Reading of input files: TOML text and overrides become a checked value of any type.
//!
//! The steps are: text, TOML tree with positions, `--set` overrides, numbered tree, value, check.
//! Every node of the tree gets a number before it is deserialised, so that an error of serde leads
//! back to one node, its dotted path and its line. The nodes are kept, so that an error found
//! later, in the set-up of a run, still gets its line.

use std::fmt::{self, Write as _};
use std::path::Path;

use serde::de::DeserializeOwned;
use thiserror::Error;
use toml::Spanned;
use toml::de::{DeFloat, DeTable, DeValue};

use super::check::{Check, Problem};
use super::mistaken::Mistaken;
use super::stand_in::{Tried, Wrong};
use super::text::{join, lies_in, one_line, related};
use boresight_common::warning::Warning;

/// How often a file is read again after errors: as many errors, or trials, are told at most.
const MOST_TURNS: usize = 100;

/// What a scenario that is no file is called in its errors.
pub const TEXT: &str = "scenario text";

/// A kind of input file.
pub trait Checked: DeserializeOwned {
    /// Adds what follows from its values; before the check.
    fn complete(&mut self) {}

    /// Reports values that are out of range or contradict each other.
    fn check(&self, check: &mut Check);

    /// Puts into the document what some of its tables take over from others.
    fn inherit(_document: &mut DeTable) {}

    /// What another kind of file a document is, judged by its own keys.
    fn mistaken(_document: &DeTable) -> Option<Mistaken> {
        None
    }
}

/// A checked value, and where its keys stand.
pub struct Parsed<T> {
    pub value: T,
    pub places: Places,
}

/// Why an input file cannot be used; prints as one line.
#[derive(Debug, Error)]
pub enum InputError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}; name an existing file")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{place}: not TOML: {message}")]
    Syntax {
        /// Where the text stops being TOML.
        place: Place,
        /// What was found and expected.
        message: String,
    },
    /// An override cannot be applied.
    #[error("{place}: {message}")]
    Override {
        /// The override.
        place: Place,
        /// What is wrong with it.
        message: String,
    },
    /// The file is one of another kind.
    #[error("{place}: {}", mistaken.message(&place.file))]
    Kind {
        /// Where a key stands that shows it.
        place: Place,
        /// What it is, and which command takes it.
        mistaken: Box<Mistaken>,
    },
    /// A value is unknown, absent, of the wrong type, out of range, or refused by the set-up.
    #[error("{place}: {path}: {message}")]
    Field {
        /// Where the value, or the table that lacks it, stands.
        place: Place,
        /// Dotted path of the value such as `uavs[0].model`.
        path: String,
        /// What was found and what would be right.
        message: String,
    },
}

/// Where a value stands: a line of the file, an override, or neither.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub file: String,
    /// Line, from 1; none for an override and for a default.
    pub line: Option<usize>,
    /// The override `key=value`.
    pub set: Option<String>,
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str(&self.file)?;
        // Editors follow the one to a file's line; a text has none to follow.
        match self.line {
            Some(line) if self.file == TEXT => write!(formatter, ", line {line}")?,
            Some(line) => write!(formatter, ":{line}")?,
            None => {}
        }
        if let Some(set) = &self.set {
            write!(formatter, ": --set {set}")?;
        }
        Ok(())
    }
}

/// The text of a file.
pub fn read(path: &Path) -> Result<String, InputError> {
    std::fs::read_to_string(path).map_err(|source| InputError::Read {
        file: path.display().to_string(),
        source,
    })
}

/// Parses and checks a text; `file` appears in errors, the first of which, in the text's order, is given.
///
/// An override `uavs.0.model=fpv5` replaces one value, or adds it with the tables around it. Its
/// right side is TOML, or a string where it is not.
pub fn parse<T: Checked>(
    text: &str,
    file: &str,
    overrides: &[String],
) -> Result<Parsed<T>, InputError> {
    parse_all(text, file, overrides, Vec::new()).map_err(Faults::first)
}

/// As [`parse`], with all errors that can be found at once, and those `known` before.
pub fn parse_all<T: Checked>(
    text: &str,
    file: &str,
    overrides: &[String],
    known: Vec<Found>,
) -> Result<Parsed<T>, Faults> {
    let mut places = Places::new(text, file, overrides);
    let mut found = known;
    // The right sides as documents of their own; leading blanks make their positions continue
    // those of the text.
    let documents: Vec<String> = (overrides.iter().zip(&places.overrides))
        .map(|(set, (start, _))| {
            let value = set.split_once('=').map_or("", |(_, value)| value);
            format!("{}v={value}", " ".repeat(*start))
        })
        .collect();

    let root = DeTable::parse(text).map_err(|error| {
        Faults::from(InputError::Syntax {
            place: places.place(error.span().map_or(0, |span| span.start)),
            message: one_line(error.message()),
        })
    })?;
    if let Some(mistaken) = T::mistaken(root.get_ref()) {
        let key = root.get_ref().get_key_value(mistaken.key);
        let place = places.place(key.map_or(0, |(key, _)| key.span().start));
        let mistaken = Box::new(mistaken);
        return Err(InputError::Kind { place, mistaken }.into());
    }
    let mut root = Spanned::new(0..0, DeValue::Table(root.into_inner()));
    for (index, document) in documents.iter().enumerate() {
        let (start, _) = places.overrides[index];
        if let Err(message) = apply(&mut root, &overrides[index], start, document) {
            let place = places.place(start);
            found.push(Found {
                at: Some(start),
                path: String::new(),
                error: InputError::Override { place, message },
            });
        }
    }

    if let DeValue::Table(document) = root.get_mut() {
        T::inherit(document);
    }
    let root = places.number(root, String::new(), &mut found);
    let (value, stood_in) = places.read::<T>(root, &mut found);
    if let Some(mut value) = value {
        value.complete();
        let mut check = Check::default();
        value.check(&mut check);
        let own = check.into_problems().into_iter();
        // What follows from another error is none of its own.
        let own = own.filter(|problem| {
            let follows = |path: &str| {
                let told = found.iter().any(|other| other.concerns(path));
                told || stood_in.iter().any(|place| lies_in(path, place))
            };
            !follows(&problem.path) && !problem.with.is_some_and(follows)
        });
        let own: Vec<_> = own.map(|problem| places.found(&problem)).collect();
        found.extend(own);
        if found.is_empty() {
            return Ok(Parsed { value, places });
        }
    }
    found.sort_by_key(|found| found.at);
    Err(Faults(found.into_iter().map(|found| found.error).collect()))
}

/// All that is wrong with a file, in its order; at least one error.
#[derive(Debug, Default)]
pub struct Faults(Vec<InputError>);

impl Faults {
    /// The errors.
    pub fn all(&self) -> &[InputError] {
        &self.0
    }

    /// The first of them.
    pub fn first(self) -> InputError {
        let none = InputError::Syntax {
            place: Place::default(),
            message: "cannot be read".to_owned(),
        };
        self.0.into_iter().next().unwrap_or(none)
    }
}

impl From<InputError> for Faults {
    fn from(error: InputError) -> Self {
        Self(vec![error])
    }
}

/// An error, and what it is about.
pub struct Found {
    /// Its offset in the virtual text.
    pub(super) at: Option<usize>,
    /// Dotted path of the value; empty where it is about none.
    pub(super) path: String,
    /// What is said of it.
    pub(super) error: InputError,
}

impl Found {
    /// Whether an error of the value at `path` would be about the same.
    fn concerns(&self, path: &str) -> bool {
        !self.path.is_empty() && related(&self.path, path)
    }
}

/// Puts the override `set`, whose right side also stands in `document`, into the tree; what is
/// wrong with it.
fn apply<'i>(
    root: &mut Spanned<DeValue<'i>>,
    set: &str,
    start: usize,
    document: &'i str,
) -> Result<(), String> {
    let (path, text) = (set.split_once('=')).ok_or_else(|| "expected key=value".to_owned())?;
    let mut slot = root;
    let mut walked = String::new();
    for key in path.split('.').map(str::trim) {
        slot = entry(slot.get_mut(), key, start).map_err(|why| format!("{walked} {why}"))?;
        join(&mut walked, key);
    }
    // One key more in the document would be an injected line.
    let value = (DeTable::parse(document).ok())
        .map(Spanned::into_inner)
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("v"));
    *slot = value.unwrap_or_else(|| {
        Spanned::new(start..start, DeValue::String(text.trim().to_owned().into()))
    });
    Ok(())
}

/// Gives a table what it lacks of another, table by table.
pub(super) fn fill<'i>(table: &mut DeTable<'i>, from: &DeTable<'i>) {
    for (key, value) in from {
        match table.get_mut(key) {
            None => {
                table.insert(key.clone(), value.clone());
            }
            Some(own) => {
                if let (DeValue::Table(own), DeValue::Table(other)) =
                    (own.get_mut(), value.get_ref())
                {
                    fill(own, other);
                }
            }
        }
    }
}

/// The value under `key` of a table, or the item of an array; else why there is none. A key that
/// is not there is added as an empty table: unknown names are found later.
fn entry<'t, 'i>(
    value: &'t mut DeValue<'i>,
    key: &str,
    at: usize,
) -> Result<&'t mut Spanned<DeValue<'i>>, String> {
    match value {
        DeValue::Table(table) => Ok(table
            .entry(Spanned::new(at..at, key.to_owned().into()))
            .or_insert_with(|| Spanned::new(at..at, DeValue::Table(DeTable::new())))),
        DeValue::Array(array) => {
            let len = array.len();
            (key.parse::<usize>().ok())
                .and_then(|index| array.get_mut(index))
                .ok_or_else(|| format!("has {len} entries, numbered from 0: no entry '{key}'"))
        }
        other => Err(format!("is of type {}, it has no keys", other.type_str())),
    }
}

/// Where every key and value of a document stands: in its text, or in an override.
///
/// Positions are offsets into one virtual text: that of the file, followed by the overrides.
#[derive(Clone, Debug, PartialEq)]
pub struct Places {
    file: String,
    /// Offset of every line's end.
    line_ends: Vec<usize>,
    /// Offset of each override's start, and the override.
    overrides: Vec<(usize, String)>,
    /// Every key and value, a key before its value; a numbered tree's spans are indices into this.
    nodes: Vec<Node>,
}

/// One key or value.
#[derive(Clone, Debug, PartialEq)]
struct Node {
    path: String,
    /// Its offset in the virtual text.
    at: usize,
}

impl Places {
    pub(super) fn new(text: &str, file: &str, overrides: &[String]) -> Self {
        let mut end = text.len();
        let overrides = overrides.iter().map(|set| {
            let start = end + 1;
            end = start + set.len();
            (start, one_line(set))
        });
        Self {
            file: file.to_owned(),
            overrides: overrides.collect(),
            line_ends: text.match_indices('\n').map(|(at, _)| at).collect(),
            nodes: Vec::new(),
        }
    }

    /// What the document is called in errors.
    pub(super) fn file(&self) -> &str {
        &self.file
    }

    fn place(&self, offset: usize) -> Place {
        let set = (self.overrides.iter().rev())
            .find(|(start, _)| *start <= offset)
            .map(|(_, set)| set.clone());
        let line = 1 + self.line_ends.partition_point(|end| *end < offset);
        Place {
            file: self.file.clone(),
            line: set.is_none().then_some(line),
            set,
        }
    }

    /// Gives every key and value its number; a number that is none becomes 0.
    fn number<'i>(
        &mut self,
        value: Spanned<DeValue<'i>>,
        path: String,
        found: &mut Vec<Found>,
    ) -> Spanned<DeValue<'i>> {
        let at = value.span().start;
        let id = self.push(&path, at);
        let value = match value.into_inner() {
            DeValue::Table(table) => DeValue::Table(
                (table.into_iter())
                    .map(|(key, value)| {
                        let mut child = path.clone();
                        join(&mut child, key.get_ref());
                        let key_id = self.push(&child, key.span().start);
                        let key = Spanned::new(key_id, key.into_inner());
                        (key, self.number(value, child, found))
                    })
                    .collect(),
            ),
            DeValue::Array(array) => DeValue::Array(
                (array.into_iter().enumerate())
                    .map(|(index, item)| self.number(item, format!("{path}[{index}]"), found))
                    .collect(),
            ),
            DeValue::Float(float) if !float.as_str().parse().is_ok_and(f64::is_finite) => {
                found.push(self.field(Some(at), &path, "must be a finite number"));
                DeValue::Float(DeFloat::default())
            }
            other => other,
        };
        Spanned::new(id, value)
    }

    /// The value of a numbered tree, what is wrong with it, and the paths at which something stands in: after each error the
    /// tree is mended and read again. `None` where that comes to no end.
    fn read<T: Checked>(
        &mut self,
        mut root: Spanned<DeValue<'_>>,
        found: &mut Vec<Found>,
    ) -> (Option<T>, Vec<String>) {
        let mut tried = Tried::default();
        // Errors inside these, and keys that another was mistaken for, are not the file's.
        let (mut stood_in, mut mistaken) = (Vec::new(), Vec::new());
        for _ in 0..MOST_TURNS {
            let error = match T::deserialize(toml::de::ValueDeserializer::from(root.clone())) {
                Ok(value) => return (Some(value), stood_in),
                Err(error) => error,
            };
            let Explained {
                found: said,
                wrong,
                meant,
                id,
            } = self.explain(&error);
            let path = said.path.clone();
            let new = self.push(&path, said.at.unwrap_or_default()).start;
            let missing = matches!(wrong, Wrong::Missing(_));
            let follows = found.iter().any(|other| other.concerns(&path))
                || stood_in.iter().any(|place| lies_in(&path, place))
                || (missing && mistaken.contains(&path));
            if !follows {
                found.push(said);
            }
            mistaken.extend(meant);
            if !matches!(wrong, Wrong::Unknown(_)) {
                stood_in.push(path.clone());
            }
            let nodes = &self.nodes;
            let paths = |id: usize| {
                nodes
                    .get(id)
                    .map_or(String::new(), |node| node.path.clone())
            };
            if !tried.mend(&mut root, (id, &path), &wrong, &paths, new) {
                break;
            }
        }
        (None, stood_in)
    }

    fn push(&mut self, path: &str, at: usize) -> std::ops::Range<usize> {
        let path = path.to_owned();
        self.nodes.push(Node { path, at });
        self.nodes.len() - 1..self.nodes.len()
    }

    /// Offset of the value at `path`.
    fn find(&self, path: &str) -> Option<usize> {
        // A value stands after its key; an override may have replaced it alone.
        let node = self.nodes.iter().rev().find(|node| node.path == path)?;
        Some(node.at)
    }

    /// Offset of the value at `path`, or of the innermost table or list around it that is there.
    fn find_around(&self, path: &str) -> Option<usize> {
        let mut path = path;
        loop {
            match self.find(path) {
                Some(at) => return Some(at),
                None => path = &path[..path.rfind(['.', '['])?],
            }
        }
    }

    /// The error of the value at `path`; it names the line of the value, or of the innermost table
    /// around it that stands in the file, or the override that gave it.
    pub fn refuse(&self, path: &str, message: impl fmt::Display) -> InputError {
        let message = message.to_string();
        (self.field(self.find_around(path), path, &message)).error
    }

    /// Warnings of the values at paths, each with what is wrong and what mends it, in the order of the text.
    pub(super) fn warnings(&self, mut said: Vec<[String; 3]>) -> Vec<Warning> {
        said.sort_by_key(|[path, ..]| self.find_around(path));
        let warning = |[path, what, mend]: [String; 3]| {
            let at = self.find_around(&path);
            let place = at.map_or_else(|| self.nowhere(), |at| self.place(at));
            Warning {
                file: place.to_string().into(),
                place: path,
                what: one_line(&what),
                mend: one_line(&mend),
            }
        };
        said.into_iter().map(warning).collect()
    }

    /// The file, and no line of it.
    fn nowhere(&self) -> Place {
        Place {
            file: self.file.clone(),
            line: None,
            set: None,
        }
    }

    /// The error at an offset of the text, or of the override of a number.
    pub(super) fn at(&self, set: Option<usize>, offset: usize, path: &str, message: &str) -> Found {
        let start = set.and_then(|number| self.overrides.get(number));
        let offset = start.map_or(offset, |(start, _)| start + offset);
        self.field(Some(offset), path, message)
    }

    /// The error of a problem that a check found.
    fn found(&self, problem: &Problem) -> Found {
        // A preset's value does not stand in the file; what it contradicts may.
        let with = problem.with.and_then(|with| self.find(with));
        let at = self.find(&problem.path).or(with);
        let at = at.or_else(|| self.find_around(&problem.path));
        self.field(at, &problem.path, &problem.message)
    }

    fn field(&self, at: Option<usize>, path: &str, message: &str) -> Found {
        Found {
            at,
            path: path.to_owned(),
            error: InputError::Field {
                place: at.map_or_else(|| self.nowhere(), |at| self.place(at)),
                path: path.to_owned(),
                message: one_line(message),
            },
        }
    }

    /// Turns serde's words about a numbered tree into ours, and into what to do about the tree.
    fn explain(&self, error: &toml::de::Error) -> Explained {
        let mut id = error.span().map_or(0, |span| span.start);
        let (mut path, at) =
            (self.nodes.get(id)).map_or((String::new(), 0), |node| (node.path.clone(), node.at));
        let message = one_line(error.message());
        // serde puts names between back quotes: first what it found, then what it knows.
        let mut names = message.split('`').skip(1).step_by(2);
        let found = names.next().unwrap_or_default().to_owned();
        let known: Vec<&str> = names.collect();
        let last_key = path.rsplit('.').next().unwrap_or_default();
        let last_key = last_key.split('[').next().unwrap_or_default().to_owned();
        let (mut wrong, mut meant) = (Wrong::Value, None);
        let message = if message.starts_with("missing field") {
            join(&mut path, &found);
            wrong = Wrong::Missing(found.clone());
            format!("is missing: add '{found} = ...' to this table")
        } else if message.starts_with("unknown field") {
            if last_key != found {
                join(&mut path, &found);
            }
            wrong = Wrong::Unknown(found.clone());
            let table = path.strip_suffix(&*one_line(&found)).unwrap_or("");
            meant = nearest(&found, &known).map(|name| format!("{table}{name}"));
            format!("unknown key{}", suggestion(&found, &known))
        } else if message.starts_with("unknown variant") {
            // The kind of a flight decides what its other keys are: all of it goes.
            let flight = path.strip_suffix(".kind");
            match flight.filter(|flight| flight.ends_with("trajectory")) {
                Some(flight) => {
                    id = self.number_of(flight).unwrap_or(id);
                    path = flight.to_owned();
                }
                None => wrong = Wrong::NoneOf(known.iter().map(ToString::to_string).collect()),
            }
            format!("unknown {last_key} '{found}'{}", suggestion(&found, &known))
        } else {
            let words = (message.replace("f64", "a number"))
                .replace("floating point ", "")
                .replace("invalid type: map", "invalid type: table")
                .replace("expected u32", "expected a whole number, not negative")
                .replace("expected u64", "expected a whole number, not negative")
                .replace("expected u8", "expected a whole number from 0 to 255");
            match words.split_once("expected struct ") {
                Some((found, _)) => format!("{found}expected a table"),
                None => words,
            }
        };
        Explained {
            found: self.field(Some(at), &path, &message),
            wrong,
            meant,
            id,
        }
    }

    /// The number of the value at a path, where it stands in the file.
    fn number_of(&self, path: &str) -> Option<usize> {
        // A key comes before its value.
        self.nodes.iter().rposition(|node| node.path == path)
    }
}

/// What serde's words about a numbered tree say.
struct Explained {
    /// The error.
    found: Found,
    /// What to do about the tree.
    wrong: Wrong,
    /// Path of the key that an unknown one was probably meant to be.
    meant: Option<String>,
    /// The number of the node.
    id: usize,
}

/// The known name that another was probably meant to be.
fn nearest<'k>(found: &str, known: &[&'k str]) -> Option<&'k str> {
    let distance = |name: &&str| strsim::levenshtein(found, name);
    let nearest = known.iter().copied().min_by_key(distance);
    nearest.filter(|name| distance(name) <= name.len() / 2)
}

/// "did you mean" and the known names.
pub fn suggestion(found: &str, known: &[&str]) -> String {
    let mut text = String::new();
    if let Some(name) = nearest(found, known) {
        let _ = write!(text, " - did you mean '{name}'?");
    } else {
        text.push_str(" -");
    }
    let _ = write!(text, " expected one of {}", known.join(", "));
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Default, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Kitchen {
        oven: Oven,
        pots: Vec<Pot>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Oven {
        heat_c: f64,
        trays: u32,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Pot {
        litres: f64,
    }

    impl Default for Oven {
        fn default() -> Self {
            Self {
                heat_c: 180.0,
                trays: 2,
            }
        }
    }

    impl Checked for Kitchen {
        fn check(&self, check: &mut Check) {
            check.table("oven", |check| {
                check.within("heat_c", self.oven.heat_c, 50.0..=300.0);
                check.that(self.oven.trays > 0, "trays", || "is empty".to_owned());
            });
            for (index, pot) in self.pots.iter().enumerate() {
                check.positive(&format!("pots[{index}].litres"), pot.litres);
            }
        }
    }

    const TEXT: &str = "# a kitchen\n[oven]\ntrays = 1\n\n[[pots]]\nlitres = 2\n\n[[pots]]\n\
                        litres = 5\n";

    fn parsed(text: &str, sets: &[&str]) -> Result<Parsed<Kitchen>, InputError> {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        parse(text, "k.toml", &sets)
    }

    fn error(text: &str, sets: &[&str]) -> String {
        parsed(text, sets).err().unwrap().to_string()
    }

    #[test]
    fn any_type_gets_the_same_errors() {
        let with = |from: &str, to: &str| error(&TEXT.replace(from, to), &[]);
        assert_eq!(
            with("litres = 5", "liters = 5"),
            "k.toml:9: pots[1].liters: unknown key - did you mean 'litres'? expected one of litres"
        );
        assert_eq!(
            with("trays = 1", "heat_c = 20"),
            "k.toml:3: oven.heat_c: found 20, must be from 50 to 300"
        );
        assert_eq!(
            with("trays = 1", "heat_c = inf"),
            "k.toml:3: oven.heat_c: must be a finite number"
        );
        assert_eq!(
            error(TEXT, &["oven.trays=0"]),
            "k.toml: --set oven.trays=0: oven.trays: is empty"
        );
        assert!(parsed("", &[]).is_ok());
    }

    #[test]
    fn what_the_set_up_refuses_is_named_where_it_stands() {
        let refused = |text: &str, sets: &[&str], path: &str| {
            let places = parsed(text, sets).unwrap().places;
            places.refuse(path, "too\nhot").to_string()
        };
        let given = |path: &str| refused(TEXT, &[], path);
        assert_eq!(given("oven.trays"), "k.toml:3: oven.trays: too hot");
        // Absent: the innermost table or list around it.
        assert_eq!(given("oven.heat_c"), "k.toml:2: oven.heat_c: too hot");
        assert_eq!(
            given("pots[1].lid.knob"),
            "k.toml:8: pots[1].lid.knob: too hot"
        );
        assert_eq!(given("sink.tap"), "k.toml: sink.tap: too hot");
        assert_eq!(refused("", &[], "oven"), "k.toml: oven: too hot");
        // Overridden, within a table of the file and without.
        let sets = ["pots.0.litres=3", "oven.heat_c = 200"];
        assert_eq!(
            refused(TEXT, &sets, "pots[0].litres"),
            "k.toml: --set pots.0.litres=3: pots[0].litres: too hot"
        );
        assert_eq!(
            refused(TEXT, &sets, "oven.heat_c"),
            "k.toml: --set oven.heat_c = 200: oven.heat_c: too hot"
        );
        assert_eq!(refused(TEXT, &sets, "oven"), "k.toml:2: oven: too hot");
        assert_eq!(
            refused("", &sets[1..], "oven.trays"),
            "k.toml: --set oven.heat_c = 200: oven.trays: too hot"
        );
        // A dotted key is a table without a header.
        assert_eq!(
            refused("\noven.trays = 1", &[], "oven.heat_c"),
            "k.toml:2: oven.heat_c: too hot"
        );
    }
}
