//! What a beam does to a UAV: heat in the layers of the wall that it falls on, a hole, and what behind it fails.
//!
//! A [`Skin`] is a wall of layers before a component with a limit of its own. A [`HeatGrid`] holds temperatures and mass
//! of its cells, a [`Patch`] lays such a grid on the place of a UAV that the beam meets ([`Hull`]). Materials are classes
//! with handbook values, none is a product's.
//!
//! Assumptions: light is absorbed at the surface; what ablates leaves at once and dims no light; the back of the last
//! layer loses nothing; properties do not change with temperature but for the absorptivity; polymers turn black where
//! they begin to ablate; a wall is flat over a grid.

mod cooling;
mod grid;
mod hull;
pub mod material;
mod parts;
mod patch;
mod skin;
#[cfg(test)]
mod tests;

pub use cooling::Film;
pub use grid::HeatGrid;
pub use hull::{Hull, Meets};
pub use material::{CHAR_ABSORPTIVITY, Material};
pub use parts::{Effect, Parts, Struck};
pub use patch::{FAILS_RADIUS_M, Falls, Patch};
pub use skin::{
    ABS_SHELL, ALUMINIUM, CARBON_EPOXY, LIPO_POUCH, Layer, MOTOR_BELL, POLYCARBONATE_SHELL, Room,
    SHELLED_POUCH, Skin,
};
