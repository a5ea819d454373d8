//! What a tile shows, whatever format it is stored in: b3dm, i3dm, pnts and cmpt (3D Tiles 1.0, OGC 18-053r2),
//! glTF 2.0 with its extensions (3D Tiles 1.1, OGC 22-025r4), any of them inside gzip. `docs/tile-content.md` says
//! which library reads what.

mod error;
mod model;

pub use error::{ContentError, Fault};
pub use model::{Content, Fetch, UpAxis};

/// Decodes the bytes of a content. `up_axis` is that of its glTF models, `fetch` reads what it refers to (images,
/// buffers, models of instances, schemas of metadata); its error is passed on in words.
pub fn decode(bytes: &[u8], up_axis: UpAxis, fetch: Fetch) -> Result<Content, ContentError> {
    let _ = (bytes, up_axis, fetch);
    Err(ContentError::new(
        "content",
        Fault::Unsupported("everything is, so far".into()),
    ))
}
