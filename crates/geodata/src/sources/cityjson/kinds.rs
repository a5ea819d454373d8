//! What kinds of city objects are, and their colours.

use crate::sources::LayerKind;

/// What a city object's triangles are.
pub fn kind(object: &str) -> LayerKind {
    let ground = [
        "LandUse",
        "Road",
        "Railway",
        "Square",
        "TransportSquare",
        "Track",
        "Waterway",
        "WaterBody",
        "TINRelief",
        "GenericCityObject",
    ];
    let ground = ground.contains(&object) || (object == "PlantCover");
    if object.starts_with("Building") {
        LayerKind::Buildings
    } else if ground {
        LayerKind::Terrain
    } else {
        LayerKind::Surface
    }
}

/// Linear albedo of a surface by what it is, where the file gives no material.
pub fn albedo(object: &str, semantics: Option<&str>, up: f64) -> [f32; 4] {
    let [r, g, b] = match (semantics, object) {
        (Some("RoofSurface" | "OuterCeilingSurface"), _) => [0.30, 0.16, 0.12],
        (Some("GroundSurface"), _) => [0.18, 0.18, 0.18],
        (Some("Window"), _) => [0.08, 0.10, 0.12],
        (Some("Door"), _) => [0.16, 0.10, 0.06],
        (Some("WaterSurface"), _) | (_, "WaterBody" | "Waterway") => [0.05, 0.10, 0.13],
        (_, "Road" | "Railway" | "Square" | "TransportSquare" | "Track") => [0.12, 0.12, 0.12],
        (_, "PlantCover" | "SolitaryVegetationObject") => [0.08, 0.16, 0.05],
        (_, "LandUse" | "TINRelief" | "GenericCityObject") => [0.16, 0.18, 0.10],
        (None, _) if object.starts_with("Building") && up > 0.5 => [0.30, 0.16, 0.12],
        _ => [0.38, 0.34, 0.29],
    };
    [r, g, b, 1.0]
}
