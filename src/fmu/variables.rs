//! The variables of the unit, which its description names and its library gets and sets.

use crate::models::decision::tracker::TrackingState;

/// What a variable is to who simulates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Fixed before the run begins.
    Parameter,
    /// Set before each step.
    Input,
    /// Got after each step.
    Output,
}

/// The type of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// A number with a unit by its symbol; empty for none.
    Float64(&'static str),
    /// Yes or no.
    Boolean,
    /// A whole number.
    UInt64,
    /// One of [`STATES`], got as fmi3Int64.
    State,
}

/// A variable of the unit.
#[derive(Clone, Copy, Debug)]
pub struct Variable {
    /// Its value reference.
    pub reference: u32,
    /// Its name.
    pub name: &'static str,
    /// What it is, in words.
    pub description: &'static str,
    /// Its type.
    pub of: Type,
    /// What it is to who simulates.
    pub causality: Causality,
}

macro_rules! variables {
    ($($constant:ident = $reference:literal: $causality:ident $of:expr, $name:literal, $description:literal;)*) => {
        /// Value references by their names.
        pub mod reference {
            $(#[doc = $description] pub const $constant: u32 = $reference;)*
        }
        /// All of them but the time, in the order of their references.
        pub const VARIABLES: &[Variable] = &[$(Variable {
            reference: $reference,
            name: $name,
            description: $description,
            of: $of,
            causality: Causality::$causality,
        }),*];
    };
}

use Type::{Boolean, Float64, State, UInt64};

/// Value reference of the time.
pub const TIME: u32 = 0;

variables! {
    SEED = 1: Parameter UInt64, "seed", "Seed of every random stream";
    DRIVE = 10: Input Boolean, "drive", "Whether the inputs drive gimbal and mirror, in place of the station's law";
    GIMBAL_AZIMUTH = 11: Input Float64("rad/s"), "gimbal_rate.azimuth", "Rate of azimuth that is wanted, clockwise from north";
    GIMBAL_ELEVATION = 12: Input Float64("rad/s"), "gimbal_rate.elevation", "Rate of elevation that is wanted, up";
    MIRROR_RIGHT = 13: Input Float64("rad"), "mirror.right", "Deflection of the line of sight to the right that is wanted";
    MIRROR_UP = 14: Input Float64("rad"), "mirror.up", "Deflection of the line of sight upwards that is wanted";
    FIRE = 15: Input Boolean, "fire_authority", "Whether the laser may fire";
    HELD = 20: Output Boolean, "target.held", "Whether a target is held";
    ERROR_AZIMUTH = 21: Output Float64("rad"), "error.azimuth", "Azimuth of the target's track less that of the believed beam; 0 without a target";
    ERROR_ELEVATION = 22: Output Float64("rad"), "error.elevation", "Elevation of the target's track less that of the believed beam; 0 without a target";
    RANGE = 23: Output Float64("m"), "target.range", "Range of the target as it is measured; 0 where it is not known";
    ENCODER_AZIMUTH = 24: Output Float64("rad"), "encoder.azimuth", "Azimuth by the encoder, clockwise from north";
    ENCODER_ELEVATION = 25: Output Float64("rad"), "encoder.elevation", "Elevation by the encoder";
    RATE_AZIMUTH = 26: Output Float64("rad/s"), "rate.azimuth", "Rate of azimuth by the gyro";
    RATE_ELEVATION = 27: Output Float64("rad/s"), "rate.elevation", "Rate of elevation by the gyro";
    AT_RIGHT = 28: Output Float64("rad"), "mirror_at.right", "Deflection of the line of sight to the right";
    AT_UP = 29: Output Float64("rad"), "mirror_at.up", "Deflection of the line of sight upwards";
    FIRING = 30: Output Boolean, "beam.firing", "Whether the laser emitted in the last tick";
    POWER = 31: Output Float64("W"), "beam.power_in_bucket", "Power inside the bucket about the aim point";
    ENERGY = 32: Output Float64("J"), "beam.energy", "Energy that the laser has emitted";
    STATE = 33: Output State, "state", "State of the engagement";
    OVER = 34: Output Boolean, "over", "Whether the run has come to its end";
    HASH = 35: Output UInt64, "state_hash", "Hash of the run's whole state: equal where runs are";
}

/// States of an engagement in the order of their numbers, from 1 on.
pub const STATES: [TrackingState; 6] = [
    TrackingState::Search,
    TrackingState::Acquire,
    TrackingState::Coarse,
    TrackingState::Precise,
    TrackingState::Engage,
    TrackingState::Lost,
];

/// The number of a state; 0 is none of them.
pub fn number_of(state: TrackingState) -> i64 {
    let at = STATES.iter().position(|other| *other == state);
    at.and_then(|at| i64::try_from(at + 1).ok()).unwrap_or(0)
}

/// The variable of a reference.
pub fn variable(reference: u32) -> Option<&'static Variable> {
    VARIABLES.iter().find(|own| own.reference == reference)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_and_references_are_given_once() {
        let names: BTreeSet<&str> = VARIABLES.iter().map(|own| own.name).collect();
        let references: BTreeSet<u32> = VARIABLES.iter().map(|own| own.reference).collect();
        assert_eq!(names.len(), VARIABLES.len());
        assert_eq!(references.len(), VARIABLES.len());
        assert!(!references.contains(&TIME));
        for own in VARIABLES {
            assert_eq!(variable(own.reference).unwrap().name, own.name);
        }
    }

    #[test]
    fn every_state_has_a_number() {
        for (at, state) in STATES.into_iter().enumerate() {
            assert_eq!(number_of(state), at as i64 + 1);
        }
    }
}
