//! Whom clients mean: vehicles and cameras by name, objects by pattern.

use crate::simulation::{CameraView, UavView, View};
use regex::RegexBuilder;

/// Largest pattern, compiled \[byte\].
const PATTERN_BYTES: usize = 1 << 18;

/// The UAVs that clients fly.
pub(super) fn vehicles(view: View<'_>) -> impl Iterator<Item = UavView<'_>> {
    view.uavs().filter(|uav| uav.distractor().is_none())
}

/// The UAV of a name; the first where it is empty.
pub(super) fn vehicle<'a>(view: View<'a>, name: &str) -> Result<UavView<'a>, String> {
    let mut all = vehicles(view);
    let found = all.find(|uav| name.is_empty() || uav.name() == name);
    found.ok_or_else(|| {
        let known = vehicles(view).map(|uav| uav.name().to_owned());
        let known: Vec<_> = known.take(20).collect();
        match known.is_empty() {
            true => "the scenario has no UAV: give it one in [[uavs]]".to_owned(),
            false => format!("no vehicle '{name}': there are {}", known.join(", ")),
        }
    })
}

/// The camera of a name, or of a number among all of the run.
pub(super) fn camera<'a>(view: View<'a>, name: &str) -> Result<CameraView<'a>, String> {
    let all = || view.stations().flat_map(|station| station.cameras());
    let number = name.parse::<usize>().ok();
    let named = all().find(|camera| camera.name() == name);
    let numbered = || all().find(|camera| Some(camera.index()) == number);
    named.or_else(numbered).ok_or_else(|| {
        let known = all().map(|camera| format!("{} ({})", camera.index(), camera.name()));
        let known: Vec<_> = known.collect();
        format!("no camera '{name}': there are {}", known.join(", "))
    })
}

/// Which of some names a regular expression matches, as a whole, in any case.
pub(super) fn matching(pattern: &str, names: Vec<String>) -> Result<Vec<String>, String> {
    let pattern = RegexBuilder::new(&format!("^(?:{pattern})$"))
        .case_insensitive(true)
        .size_limit(PATTERN_BYTES)
        .build()
        .map_err(|_| {
            let shown: String = pattern.chars().take(60).collect();
            format!("'{shown}' is no regular expression that can be used")
        })?;
    let names = names.into_iter();
    Ok(names.filter(|name| pattern.is_match(name)).collect())
}

/// Whether a name fits a pattern in which `*` is any text and `?` any letter.
pub(super) fn fits(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    // Where the last star stands, and the name from which it takes no more.
    let mut star = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(c) if *c == '?' || *c == name[n] => {
                p += 1;
                n += 1;
            }
            _ => match star {
                Some((at, from)) => {
                    star = Some((at, from + 1));
                    (p, n) = (at + 1, from + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_fit_names() {
        for (pattern, name, wanted) in [
            ("intruder", "intruder", true),
            ("intruder", "intruder2", false),
            ("intru*", "intruder2", true),
            ("*", "", true),
            ("*der?", "intruder2", true),
            ("*der?", "intruder", false),
            ("a*b*c", "axxbxbyc", true),
            ("a*b*c", "axxbxby", false),
            ("", "x", false),
        ] {
            assert_eq!(fits(pattern, name), wanted, "{pattern} {name}");
        }
    }

    #[test]
    fn expressions_match_whole_names_and_bad_ones_are_said() {
        let names = || {
            ["Ground", "Building_1", "building_12"]
                .map(String::from)
                .to_vec()
        };
        assert_eq!(matching(".*", names()).unwrap().len(), 3);
        assert_eq!(matching("building_1", names()).unwrap(), ["Building_1"]);
        assert_eq!(matching(r"building[\w]*", names()).unwrap().len(), 2);
        let error = matching("(", names()).unwrap_err();
        assert!(error.contains("no regular expression"), "{error}");
        assert!(matching(&"(x{1000}){1000}".repeat(5), names()).is_err());
    }
}
