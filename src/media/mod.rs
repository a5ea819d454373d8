//! Pictures and clips, in and out.

pub mod video;
