//! What a file states that the program took in some way, or left out: no error, but never silent.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// One thing about a file that its user should know; prints as one line, as an error does.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Warning {
    /// The file, with its line, or the override.
    pub file: PathBuf,
    /// Where in the file: a line, an object's name, a key.
    pub place: String,
    /// What was assumed or left out there.
    pub what: String,
    /// How to state or mend it.
    pub mend: String,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let file = self.file.display();
        write!(f, "{file}: {}: {}; {}", self.place, self.what, self.mend)
    }
}

/// Whether warnings are errors in this process.
static STRICT: AtomicBool = AtomicBool::new(false);
/// What this process has printed.
static TOLD: Mutex<BTreeSet<Warning>> = Mutex::new(BTreeSet::new());

/// Warnings where they are errors; prints as one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "--strict makes errors of warnings ({0} above); mend what is named there, or leave --strict out"
)]
pub struct StrictError(usize);

/// Makes warnings errors from now on, in the whole process.
pub fn be_strict() {
    STRICT.store(true, Ordering::Relaxed);
}

/// Prints warnings to standard error, a line each, every one once in a process. Where warnings are errors, any is one:
/// also one that was printed before.
pub fn tell(warnings: &[Warning]) -> Result<(), StrictError> {
    let mut told = TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    for warning in warnings {
        if told.insert(warning.clone()) {
            // A closed pipe is no error.
            let _ = writeln!(std::io::stderr(), "warning: {warning}");
        }
    }
    match STRICT.load(Ordering::Relaxed) && !warnings.is_empty() {
        true => Err(StrictError(warnings.len())),
        false => Ok(()),
    }
}

/// How many different warnings this process has printed.
pub fn told() -> usize {
    TOLD.lock().unwrap_or_else(PoisonError::into_inner).len()
}

/// What the reader of one file notes on its way.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    assumed: Vec<[String; 3]>,
    left_out: BTreeMap<String, LeftOut>,
}

/// Records of one kind that a reader leaves out.
#[derive(Clone, Debug)]
struct LeftOut {
    count: u64,
    first: String,
}

impl Notes {
    /// Notes what was taken for granted at a place, once for all equal notes.
    pub fn assume(&mut self, place: impl ToString, what: impl ToString, mend: impl ToString) {
        let note = [place.to_string(), what.to_string(), mend.to_string()];
        if !self.assumed.contains(&note) {
            self.assumed.push(note);
        }
    }

    /// Counts a record that is left out: its kind in the plural, with the reason ("buildings under the ground"), and where it stands.
    pub fn leave_out(&mut self, kind: impl ToString, place: impl ToString) {
        let kind = self.left_out.entry(kind.to_string());
        let first = || LeftOut {
            count: 0,
            first: place.to_string(),
        };
        kind.or_insert_with(first).count += 1;
    }

    /// How many records are left out.
    pub fn count_left_out(&self) -> u64 {
        self.left_out.values().map(|left_out| left_out.count).sum()
    }

    /// Takes in the notes of another part of the same file.
    pub fn extend(&mut self, other: Self) {
        for [place, what, mend] in other.assumed {
            self.assume(place, what, mend);
        }
        for (kind, more) in other.left_out {
            match self.left_out.get_mut(&kind) {
                Some(own) => own.count += more.count,
                None => {
                    self.left_out.insert(kind, more);
                }
            }
        }
    }

    /// What is left out, kind by kind, with how many and the first.
    pub fn left_out(&self) -> Vec<String> {
        let said = |(kind, LeftOut { count, first }): (&String, &LeftOut)| {
            let example = if *count == 1 { "" } else { "first " };
            format!("{count} {kind} ({example}{first})")
        };
        self.left_out.iter().map(said).collect()
    }

    /// What is left out, in brackets behind another text; nothing where nothing is.
    pub fn left_out_in_brackets(&self) -> String {
        let kinds = self.left_out();
        match kinds.is_empty() {
            true => String::new(),
            false => format!(" ({})", kinds.join(", ")),
        }
    }

    /// The warnings of a file: what was assumed, a line each, and one line that counts and names all that is left out.
    pub fn warnings(self, file: &Path) -> Vec<Warning> {
        let warning = |[place, what, mend]: [String; 3]| Warning {
            file: file.into(),
            place,
            what,
            mend,
        };
        let kinds = self.left_out();
        let mut warnings: Vec<_> = self.assumed.into_iter().map(warning).collect();
        if !kinds.is_empty() {
            warnings.push(warning([
                "left out".into(),
                kinds.join(", "),
                "the rest is read".into(),
            ]));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_counted_in_one_line() {
        let mut notes = Notes::default();
        notes.assume("heights", "over the geoid", "say it with --crs");
        notes.assume("heights", "over the geoid", "say it with --crs");
        notes.leave_out("profiles of an unknown kind", "#12 IfcEgg");
        notes.leave_out("profiles of an unknown kind", "#13 IfcEgg");
        let mut more = Notes::default();
        more.leave_out("products without a shape", "#4");
        notes.extend(more);
        assert_eq!(notes.count_left_out(), 3);
        let lines: Vec<_> = (notes.warnings(Path::new("a.ifc")).iter())
            .map(ToString::to_string)
            .collect();
        let want = [
            "a.ifc: heights: over the geoid; say it with --crs",
            "a.ifc: left out: 1 products without a shape (#4), 2 profiles of an unknown kind (first #12 IfcEgg); the \
             rest is read",
        ];
        assert_eq!(lines, want);
        assert!(Notes::default().warnings(Path::new("a.ifc")).is_empty());
    }
}
