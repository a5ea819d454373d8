//! Where the files of a place lie.

use std::path::Path;

/// A path of a scenario as seen from the working directory; an address stays.
pub fn located(folder: &Path, path: &str) -> String {
    let address = ["http://", "https://"];
    if address
        .iter()
        .any(|start| path.to_ascii_lowercase().starts_with(start))
    {
        return path.to_owned();
    }
    folder.join(path).to_string_lossy().into_owned()
}
