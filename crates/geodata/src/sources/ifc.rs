//! IFC (STEP) building models: what their products look like, and where they belong: room, storey, building.
//!
//! `ifc-lite-core` reads the records; it makes no geometry, and its georeferencing takes defaults where something is not understood, so
//! that units and georeferencing are read here. What is made and what is not: `docs/sources.md`.

mod brep;
mod curve;
mod georeference;
mod known;
mod layer;
mod model;
mod pipe;
mod placing;
mod products;
mod profile;
mod shape;
mod system;
mod units;

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use layer::layer;
use placing::Placing;
use products::products;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// The products of an IFC file with shapes, a feature each, with name, type, room, storey and building; rooms follow as features
/// without triangles. It stands where its map conversion or its site's latitude and longitude say, or where the options say.
///
/// Fails where the file is damaged, holds no shape, states a unit or a place that is not understood, or says nowhere where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let damaged = || Fault::new("IFC", "a record is damaged", "export it again").of(path);
    // Behind the library's interface lie indices of the file's own.
    let made = catch_unwind(AssertUnwindSafe(|| products(&bytes))).map_err(|_| damaged())?;
    let mut made = made.map_err(|fault| fault.of(path))?;
    drop(bytes);
    let [low, high] = made.bounds();
    let placing = Placing {
        stated: &made.stated,
        unit_m: made.unit_m,
        middle_m: (low + high) / 2.0,
        options,
    };
    let to_ecef = placing.to_ecef(path, &mut made.notes)?;
    let mut notes = std::mem::take(&mut made.notes);
    let layer = layer(made, &to_ecef, options, &mut notes).map_err(|fault| fault.of(path))?;
    Ok(Layer {
        warnings: notes.warnings(path),
        ..layer
    })
}

#[cfg(test)]
mod tests;
