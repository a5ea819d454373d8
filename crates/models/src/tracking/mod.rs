//! From sightings to tracks: filters, the track table, what a track is, known scenery, ranges, search
//! patterns.

pub mod cartesian;
pub mod estimation;
pub mod evidence;
pub mod flutter;
pub mod held;
pub mod picture;
pub mod ranging;
pub mod recognition;
pub mod scenery;
pub mod search;
pub mod table;
