//! From sightings to tracks: filters, the track table, ranges, search patterns, the radar,
//! what a track is.

pub mod estimation;
pub mod radar;
pub mod ranging;
pub mod recognition;
pub mod search;
pub mod table;
