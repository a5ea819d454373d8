//! Clips of real cameras: H.264 in MP4 or MOV files, folders of numbered pictures; and an MP4
//! writer for what is drawn on them.
//!
//! Boxes and sample tables are those of ISO/IEC 14496-12 and -15. Colours are taken as BT.601,
//! limited range, whatever the file says.

mod boxes;
mod colour;
mod error;
mod read;
mod write;

pub use error::VideoError;
pub use read::{Clip, ClipFrame};
pub use write::Writer;

#[cfg(test)]
mod tests;
