//! Metadata of implicit tiles that says where they lie (3D Metadata Semantic Reference: `TILE_…`).

use crate::tiles::error::TilesError;
use crate::tiles::json::At;
use crate::tiles::read::{box_of, region_of, sphere_of};
use boresight_models::tiles::tree::Tile;
use boresight_models::tiles::volume::BoundingVolume;
use serde_json::Value;

/// Where the bytes of a buffer view come from.
pub(super) trait Views {
    /// The bytes of a buffer view.
    fn view(&self, index: u64) -> Result<Vec<u8>, TilesError>;
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Semantic {
    Box,
    Region,
    Sphere,
    LowestHeight,
    HighestHeight,
    Error,
}

impl Semantic {
    /// What a property means, and how many numbers it has.
    fn of(name: &str) -> Option<(Self, usize)> {
        Some(match name {
            "TILE_BOUNDING_BOX" => (Self::Box, 12),
            "TILE_BOUNDING_REGION" => (Self::Region, 6),
            "TILE_BOUNDING_SPHERE" => (Self::Sphere, 4),
            "TILE_MINIMUM_HEIGHT" => (Self::LowestHeight, 1),
            "TILE_MAXIMUM_HEIGHT" => (Self::HighestHeight, 1),
            "TILE_GEOMETRIC_ERROR" => (Self::Error, 1),
            _ => return None,
        })
    }
}

/// Columns of a property table that say where tiles lie.
#[derive(Debug)]
pub(super) struct Table {
    columns: Vec<Column>,
}

#[derive(Debug)]
struct Column {
    semantic: Semantic,
    length: usize,
    double: bool,
    bytes: Vec<u8>,
}

impl Column {
    fn row(&self, row: u64) -> Option<Vec<f64>> {
        let size = if self.double { 8 } else { 4 };
        let start = usize::try_from(row).ok()?.checked_mul(self.length * size)?;
        let bytes = self
            .bytes
            .get(start..start.checked_add(self.length * size)?)?;
        let number = |b: &[u8]| match *b {
            [a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
            [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]),
            _ => f64::NAN,
        };
        let numbers: Vec<f64> = bytes.chunks_exact(size).map(number).collect();
        numbers.iter().all(|n| n.is_finite()).then_some(numbers)
    }
}

impl Table {
    /// The table of a subtree's tiles; `None` where it says nothing of where they lie.
    pub fn read(
        views: &impl Views,
        subtree: &At,
        schema: &Value,
        number: &At,
    ) -> Result<Option<Self>, TilesError> {
        let tables = subtree.need("propertyTables")?;
        let number = number.whole(0, 1 << 20)? as usize;
        let Some(table) = tables.items()?.nth(number) else {
            return Err(tables.fault(format!("has no element {number}")));
        };
        let class = table.need("class")?;
        let class = &schema["classes"][class.text()?]["properties"];
        let mut columns = Vec::new();
        let Some(properties) = table.get("properties") else {
            return Ok(None);
        };
        for name in properties.object()?.keys() {
            let kind = &class[&name[..]];
            let semantic = kind["semantic"].as_str().and_then(Semantic::of);
            let double = match kind["componentType"].as_str() {
                Some("FLOAT64") => true,
                Some("FLOAT32") => false,
                _ => continue,
            };
            if let Some((semantic, length)) = semantic
                && let Some(property) = properties.get(name)
            {
                let values = property
                    .get("values")
                    .map_or_else(|| property.need("bufferView"), Ok)?;
                let bytes = views.view(values.whole(0, u64::MAX)?)?;
                columns.push(Column {
                    semantic,
                    length,
                    double,
                    bytes,
                });
            }
        }
        Ok((!columns.is_empty()).then_some(Self { columns }))
    }

    /// Gives a tile the volume and the error of its row.
    pub fn apply(&self, row: u64, tile: &mut Tile) -> Result<(), String> {
        for column in &self.columns {
            let wrong =
                |what: &str| format!("metadata of tile {row}: {:?} {what}", column.semantic);
            let numbers = column
                .row(row)
                .ok_or_else(|| wrong("is not there or no number"))?;
            let short = || wrong("has too few numbers");
            match column.semantic {
                Semantic::Box => {
                    let n = <[f64; 12]>::try_from(numbers).map_err(|_| short())?;
                    tile.volume = box_of(&n);
                }
                Semantic::Region => {
                    let n = <[f64; 6]>::try_from(numbers).map_err(|_| short())?;
                    tile.volume = region_of(&n).map_err(wrong)?;
                }
                Semantic::Sphere => {
                    let n = <[f64; 4]>::try_from(numbers).map_err(|_| short())?;
                    tile.volume = sphere_of(&n).map_err(wrong)?;
                }
                Semantic::Error => tile.geometric_error_m = numbers[0].max(0.0),
                Semantic::LowestHeight | Semantic::HighestHeight => {
                    if let BoundingVolume::Region { height_m, .. } = &mut tile.volume {
                        height_m[usize::from(column.semantic == Semantic::HighestHeight)] =
                            numbers[0];
                    }
                }
            }
        }
        Ok(())
    }
}
