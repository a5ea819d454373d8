//! Why tiles cannot be read.

/// What is wrong with a tileset, or in the way of reading it. Each prints as one line: where, what, and the mend.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TilesError {
    /// Something that cannot be fetched.
    #[error("{location}: {reason}")]
    Fetch {
        /// File or address.
        location: String,
        /// What is in the way, and the mend.
        reason: String,
    },
    /// Something that is not as the format wants it.
    #[error("{location}: {place}: {fault}")]
    Format {
        /// File or address.
        location: String,
        /// Where in it, such as `root.children[2].boundingVolume`.
        place: String,
        /// What is wrong, and the mend.
        fault: String,
    },
    /// Something right that is not read here.
    #[error("{location}: {what} is not supported; {mend}")]
    Unsupported {
        /// File or address.
        location: String,
        /// What it is.
        what: String,
        /// What to do instead.
        mend: String,
    },
    /// A content that cannot be decoded.
    #[error("{location}: {reason}")]
    Content {
        /// File or address.
        location: String,
        /// What the decoder said.
        reason: String,
    },
}
