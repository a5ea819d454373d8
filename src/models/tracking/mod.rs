//! From sightings to tracks: filters, the track table, ranges, search patterns, the radar.

pub mod estimation;
pub mod radar;
pub mod ranging;
pub mod search;
pub mod table;
