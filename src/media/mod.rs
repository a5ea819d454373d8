//! Pictures and clips, in and out.

pub mod image;
pub mod labels;
pub mod video;
