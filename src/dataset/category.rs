//! The categories of annotations.

use crate::models::flight::uav::{UavClass, UavKind, model};

/// The categories: number and name.
pub const CATEGORIES: [(u32, &str); 3] = [(1, "fpv"), (2, "quadcopter"), (3, "hexacopter")];

/// The category of a UAV.
pub fn category(kind: UavKind) -> u32 {
    match model(kind).class {
        UavClass::Fpv => 1,
        UavClass::Quadcopter => 2,
        UavClass::Hexacopter => 3,
    }
}
