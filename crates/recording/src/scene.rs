//! What is drawn in three dimensions: frames, and the shapes of the scene.

use foxglove::messages::{self as fg, Color, Point3, Pose, Quaternion, Vector3, line_primitive};

/// The pose of `child` in `parent`.
#[derive(Clone, Copy, Debug)]
pub struct FrameTransform<'a> {
    /// Parent frame.
    pub parent: &'a str,
    /// Child frame.
    pub child: &'a str,
    /// Origin of `child` in `parent` \[m\].
    pub translation_m: [f64; 3],
    /// Unit quaternion (x, y, z, w) that rotates a `child` vector into `parent`.
    pub rotation: [f64; 4],
}

/// A red, green, blue, alpha colour, 0 to 1 each.
pub type Rgba = [f64; 4];

/// One shape of a scene entity, in the entity's frame.
#[derive(Clone, Debug)]
pub enum SceneShape<'a> {
    /// A cuboid.
    Cube {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Unit quaternion (x, y, z, w) from the cuboid's axes to the frame's.
        rotation: [f64; 4],
        /// Edge lengths \[m\].
        size_m: [f64; 3],
        /// Colour.
        colour: Rgba,
    },
    /// A sphere.
    Sphere {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Diameter \[m\].
        diameter_m: f64,
        /// Colour.
        colour: Rgba,
    },
    /// A line through points.
    Line {
        /// Points \[m\].
        points_m: &'a [[f64; 3]],
        /// Width \[m\].
        width_m: f64,
        /// Colour.
        colour: Rgba,
    },
}

/// One thing of the three-dimensional scene; a later one with the same `id` replaces it.
#[derive(Clone, Debug)]
pub struct SceneEntity<'a> {
    /// Identity within the scene.
    pub id: &'a str,
    /// Frame of its shapes.
    pub frame: &'a str,
    /// How long it is shown \[tick\]; 0 is for ever.
    pub lifetime_ticks: u32,
    /// What it is made of.
    pub shapes: &'a [SceneShape<'a>],
}

/// Name of the city among the things of the scene.
pub const CITY: &str = "city";

impl SceneShape<'_> {
    pub(crate) fn add_to(&self, entity: &mut fg::SceneEntity) {
        const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];
        match *self {
            Self::Cube {
                centre_m,
                rotation,
                size_m,
                colour: rgba,
            } => {
                entity.cubes.push(fg::CubePrimitive {
                    pose: Some(pose(centre_m, rotation)),
                    size: Some(vector(size_m)),
                    color: Some(colour(rgba)),
                });
            }
            Self::Sphere {
                centre_m,
                diameter_m,
                colour: rgba,
            } => {
                entity.spheres.push(fg::SpherePrimitive {
                    pose: Some(pose(centre_m, UPRIGHT)),
                    size: Some(vector([diameter_m; 3])),
                    color: Some(colour(rgba)),
                });
            }
            Self::Line {
                points_m,
                width_m,
                colour: rgba,
            } => {
                entity.lines.push(fg::LinePrimitive {
                    r#type: line_primitive::Type::LineStrip.into(),
                    pose: Some(pose([0.0; 3], UPRIGHT)),
                    thickness: width_m,
                    points: points_m
                        .iter()
                        .map(|&[x, y, z]| Point3 { x, y, z })
                        .collect(),
                    color: Some(colour(rgba)),
                    ..Default::default()
                });
            }
        }
    }
}

pub(crate) fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

pub(crate) fn quaternion([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

fn pose(position_m: [f64; 3], rotation: [f64; 4]) -> Pose {
    Pose {
        position: Some(vector(position_m)),
        orientation: Some(quaternion(rotation)),
    }
}

pub(crate) fn colour([r, g, b, a]: Rgba) -> Color {
    Color { r, g, b, a }
}
