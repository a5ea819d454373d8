//! Why a content cannot be read.

use thiserror::Error;

/// Why a content cannot be read, and where in it.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{place}: {fault}")]
pub struct ContentError {
    /// The part at fault, from the outside in: `cmpt, tile 2, b3dm, batch table`.
    pub place: String,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What is wrong with a content.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum Fault {
    /// It is none of the known formats.
    #[error(
        "is no content of 3D Tiles: it begins with {0:?}; expected b3dm, i3dm, pnts, cmpt or glTF"
    )]
    Unknown(String),
    /// It ends early.
    #[error("is cut short: needs {needed} bytes and has {have}; fetch or export it again")]
    Short {
        /// What its own header or tables ask for [byte].
        needed: u64,
        /// What is there [byte].
        have: u64,
    },
    /// It contradicts itself or its specification.
    #[error("is damaged: {0}; export it again")]
    Damaged(String),
    /// It is right, but this program does not read it.
    #[error("is not supported: {0}; export it without")]
    Unsupported(String),
    /// A glTF of another version.
    #[error("is glTF of version {0}, of which 2.0 is read; export it as 2.0")]
    Version(String),
    /// A file that it refers to cannot be read.
    #[error("refers to {uri:?}, which cannot be read: {why}; put it there, or correct the address")]
    Missing {
        /// The address, as the content has it.
        uri: String,
        /// What reading it said.
        why: String,
    },
    /// It would need too much memory.
    #[error(
        "is too large: {what} of {amount} where {limit} is the limit; cut the tile into smaller ones"
    )]
    TooLarge {
        /// Of what there is too much.
        what: &'static str,
        /// How much there is.
        amount: u64,
        /// How much there may be.
        limit: u64,
    },
}

impl ContentError {
    /// A fault at a place.
    pub(crate) fn new(place: impl Into<String>, fault: Fault) -> Self {
        let place = place.into();
        Self { place, fault }
    }

    /// A contradiction at a place.
    pub(crate) fn damaged(place: impl Into<String>, why: impl Into<String>) -> Self {
        Self::new(place, Fault::Damaged(why.into()))
    }

    /// Something that is not read.
    pub(crate) fn unsupported(place: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(place, Fault::Unsupported(what.into()))
    }

    /// The same fault, seen from the part around it.
    pub(crate) fn within(self, outer: &str) -> Self {
        Self {
            place: format!("{outer}, {}", self.place),
            fault: self.fault,
        }
    }
}
