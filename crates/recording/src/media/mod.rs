//! Pictures and clips, in and out.

pub mod clip_boxes;
pub mod image;
pub mod labels;
pub mod video;
