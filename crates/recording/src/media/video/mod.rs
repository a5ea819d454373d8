//! Clips of real cameras: H.264 in MP4 or MOV files, folders of numbered pictures; and an MP4
//! writer for what is drawn on them.
//!
//! Boxes, tables, fragments and edit lists are those of ISO/IEC 14496-12 and -15. Pictures are turned, cut out and coloured
//! as the file says; where it says nothing, colours are BT.601 in limited range.

mod boxes;
mod colour;
mod description;
mod edits;
mod error;
mod fragments;
mod movie;
mod read;
mod sps;
mod tables;
mod turn;
mod write;

pub use error::VideoError;
pub use read::{Clip, ClipFrame};
pub use write::Writer;

#[cfg(test)]
mod tests;
