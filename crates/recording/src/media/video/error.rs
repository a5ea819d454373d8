//! What can be wrong with a clip.

use crate::media::image::ImageError;
use std::path::PathBuf;

/// Why a clip cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The file or folder cannot be read.
    #[error(
        "clip {path}: cannot be read ({why}); name an MP4 or MOV file with H.264, or a folder of \
         numbered pictures (PNG, JPEG)"
    )]
    Unreadable {
        /// The clip.
        path: PathBuf,
        /// What the system said.
        why: String,
    },
    /// The file is no video that is understood.
    #[error("clip {path}: {why}; convert it with `ffmpeg -i IN -pix_fmt yuv420p OUT.mp4`")]
    Format {
        /// The clip.
        path: PathBuf,
        /// What differs.
        why: String,
    },
    /// The file ends too early.
    #[error("clip {path}: {why}; the file is cut off: copy or record it again")]
    Truncated {
        /// The clip.
        path: PathBuf,
        /// What is missing.
        why: String,
    },
    /// The file is a segment of a stream.
    #[error(
        "clip {path}: it is a segment of a stream, without its index ('moov'); put the stream's first part before it with \
         `cat INIT.mp4 SEGMENT.m4s > OUT.mp4`"
    )]
    Segment {
        /// The clip.
        path: PathBuf,
    },
    /// A frame cannot be decoded.
    #[error(
        "clip {path}: frame {frame} cannot be decoded ({why}); copy the file again, or convert it \
         with `ffmpeg -i IN -pix_fmt yuv420p OUT.mp4`"
    )]
    Frame {
        /// The clip.
        path: PathBuf,
        /// Index of the frame, from 0.
        frame: usize,
        /// What the decoder said.
        why: String,
    },
    /// A file of the folder is no picture.
    #[error("clip {path}: {source}; PNG and JPEG files are read")]
    Picture {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ImageError,
    },
    /// The folder holds no pictures, or pictures that do not belong together.
    #[error("clip {path}: {why}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is wrong, and what would be right.
        why: String,
    },
    /// A clip cannot be written.
    #[error("video {path}: {why}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        why: String,
    },
}
