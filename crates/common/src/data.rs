//! What the program brings along, found from any folder: networks, shipped scenarios, recipes and experiments.

use std::path::{Path, PathBuf};

/// Names the folder of the program's data, in which `assets/models`, `scenarios` and `recipes` lie.
pub const VARIABLE: &str = "BORESIGHT_DATA";

/// A file or folder where it lies: seen from the working directory if it is there, or else in the first folder of the
/// program's data that has it. What is nowhere stays as it is named, for the error.
pub fn found(path: &Path) -> PathBuf {
    found_in(path, &folders())
}

fn found_in(path: &Path, folders: &[PathBuf]) -> PathBuf {
    if path.is_absolute() || path.as_os_str().is_empty() || path.exists() {
        return path.to_owned();
    }
    let places = folders.iter().map(|folder| folder.join(path));
    places
        .into_iter()
        .find(|place| place.exists())
        .unwrap_or_else(|| path.to_owned())
}

/// The folders that may hold the program's data, in the order in which they are asked: what [`VARIABLE`] names, beside the
/// program, where an installation puts it, and the checkout that the program was built from.
fn folders() -> Vec<PathBuf> {
    let named = std::env::var_os(VARIABLE).map(PathBuf::from);
    let program = std::env::current_exe().and_then(|path| path.canonicalize());
    let beside = program
        .ok()
        .and_then(|path| Some(path.parent()?.to_owned()));
    let installed = (beside.as_ref()).map(|folder| folder.join("../share/boresight"));
    // This crate's folder is two below the checkout's.
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2);
    (named.into_iter())
        .chain(beside)
        .chain(installed)
        .chain(built.map(Path::to_owned))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_folder_that_has_it_wins() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        for (place, name) in [(&a, "one.toml"), (&b, "one.toml"), (&b, "two.toml")] {
            std::fs::create_dir_all(place.join("none-such-here")).unwrap();
            std::fs::write(place.join("none-such-here").join(name), "").unwrap();
        }
        let both = [a.clone(), b.clone()];
        let named = |name: &str| Path::new("none-such-here").join(name);
        let found = |name: &str| found_in(&named(name), &both);
        assert_eq!(found("one.toml"), a.join(named("one.toml")));
        assert_eq!(found("two.toml"), b.join(named("two.toml")));
        assert_eq!(found("three.toml"), named("three.toml"));
        let whole = folder.path().join("absent");
        assert_eq!(found_in(&whole, &both), whole);
        // Seen from the working directory, tests being run in the crate's.
        let here = Path::new("Cargo.toml");
        assert_eq!(found_in(here, &both), here);
    }

    #[test]
    fn the_shipped_networks_are_found_from_anywhere() {
        let model = Path::new("assets/models/recogniser.onnx");
        let places = folders();
        assert!(places.iter().any(|folder| folder.join(model).exists()));
    }
}
