//! A glTF file and the bytes it refers to: container, buffers, buffer views, accessors.

use super::meshopt;
use super::schema::{Accessor, Extensions, Meshopt, Root, View};
use crate::tiles::content::bytes::{self, Kind, elements, json, part, u32_at};
use crate::tiles::content::error::{ContentError, Fault};
use crate::tiles::content::model::Context;
use crate::tiles::fetch;
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use std::cell::OnceCell;

/// Extensions that a file may require.
const KNOWN: [&str; 17] = [
    "CESIUM_RTC",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_structural_metadata",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_techniques_webgl",
    "KHR_texture_transform",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
];

/// Most elements of an accessor that is all zeros but for what is sparse, beside those of a file with as many bytes.
const MOST_ZEROS: usize = 1 << 22;

/// A glTF file.
pub(crate) struct Document<'b> {
    /// Its JSON.
    pub root: Root,
    /// The binary chunk of a .glb.
    blob: Option<&'b [u8]>,
    context: &'b Context<'b>,
    buffers: Vec<OnceCell<Cow<'b, [u8]>>>,
    /// What compressed views stand for.
    unpacked: Vec<OnceCell<Vec<u8>>>,
    /// Length of the file [byte].
    length: usize,
}

impl<'b> Document<'b> {
    /// Reads a .glb or .gltf.
    pub fn new(bytes: &'b [u8], context: &'b Context<'b>) -> Result<Self, ContentError> {
        let (text, blob) = chunks(bytes)?;
        let root: Root = json(text, "JSON")?;
        if !root.asset.version.starts_with("2.") {
            let version = Fault::Version(root.asset.version.clone());
            return Err(ContentError::new("asset", version));
        }
        let unknown =
            |name: &&String| !KNOWN.contains(&name.as_str()) && !name.starts_with("KHR_materials_");
        if let Some(name) = root.extensions_required.iter().find(unknown) {
            let what = format!("it requires the glTF extension {name}");
            return Err(ContentError::unsupported("extensionsRequired", what));
        }
        let buffers = root.buffers.iter().map(|_| OnceCell::new()).collect();
        let unpacked = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        Ok(Self {
            root,
            blob,
            context,
            buffers,
            unpacked,
            length: bytes.len(),
        })
    }

    /// What is shared with the content that it stands in.
    pub fn context(&self) -> &Context<'b> {
        self.context
    }

    /// Counts bytes that are about to be decoded; an error where they are too many.
    pub fn spend(&self, bytes: usize, place: &str) -> Result<(), ContentError> {
        self.context.spend(bytes, place)
    }

    /// The bytes of a data URI, or of the file that a URI names.
    pub fn read(&self, uri: &str, place: &str) -> Result<Vec<u8>, ContentError> {
        let Some(rest) = uri.strip_prefix("data:") else {
            return self.context.read(uri, place);
        };
        let damaged = || ContentError::damaged(place, "its data URI holds no data");
        let found = fetch::data(rest).ok_or_else(damaged)?;
        self.spend(found.len(), place)?;
        Ok(found)
    }

    /// A buffer.
    fn buffer(&self, index: usize, place: &str) -> Result<&[u8], ContentError> {
        let absent = || ContentError::damaged(place, format!("there is no buffer {index}"));
        let cell = self.buffers.get(index).ok_or_else(absent)?;
        if let Some(found) = cell.get() {
            return Ok(found);
        }
        let declared = &self.root.buffers[index];
        let place = format!("buffer {index}");
        let found: Cow<[u8]> = match (&declared.uri, self.blob) {
            (Some(uri), _) => Cow::Owned(self.read(uri, &place)?),
            (None, Some(blob)) if index == 0 => Cow::Borrowed(blob),
            _ => {
                return Err(ContentError::damaged(
                    place,
                    "it has neither a URI nor bytes",
                ));
            }
        };
        part(&found, 0, declared.byte_length, &place)?;
        Ok(cell.get_or_init(|| found))
    }

    /// A part of a buffer.
    fn range(
        &self,
        [buffer, start, length]: [usize; 3],
        place: &str,
    ) -> Result<&[u8], ContentError> {
        part(self.buffer(buffer, place)?, start, length, place)
    }

    /// A buffer view.
    fn declared(&self, view: usize, place: &str) -> Result<&View, ContentError> {
        let absent = || ContentError::damaged(place, format!("there is no buffer view {view}"));
        self.root.buffer_views.get(view).ok_or_else(absent)
    }

    /// The bytes of a buffer view, unpacked where they are compressed.
    pub fn view(&self, index: usize, place: &str) -> Result<&[u8], ContentError> {
        let view = self.declared(index, place)?;
        let names = ["KHR_meshopt_compression", "EXT_meshopt_compression"];
        let Some(name) = names
            .into_iter()
            .find(|name| view.extensions.contains_key(*name))
        else {
            return self.range([view.buffer, view.byte_offset, view.byte_length], place);
        };
        let cell = &self.unpacked[index];
        if let Some(found) = cell.get() {
            return Ok(found);
        }
        let place = format!("buffer view {index}, {name}");
        let Some(how) = extension::<Meshopt>(&view.extensions, name, &place)? else {
            return Err(ContentError::damaged(place, "it is empty"));
        };
        let data = self.range([how.buffer, how.byte_offset, how.byte_length], &place)?;
        let size = how.count.saturating_mul(how.byte_stride);
        self.spend(size, &place)?;
        let found = meshopt::decode(data, &how, &place)?;
        Ok(cell.get_or_init(|| found))
    }

    /// An accessor.
    pub fn accessor(&self, index: usize, place: &str) -> Result<&Accessor, ContentError> {
        let absent = || ContentError::damaged(place, format!("there is no accessor {index}"));
        self.root.accessors.get(index).ok_or_else(absent)
    }

    /// Each element of an accessor through `convert`, which gets its kind of number and its bytes.
    pub fn elements<T: Copy>(
        &self,
        accessor: &Accessor,
        zero: T,
        convert: impl Fn(Kind, &[u8]) -> T,
        place: &str,
    ) -> Result<Vec<T>, ContentError> {
        let (kind, components) = layout(accessor, place)?;
        let (size, count) = (kind.size() * components, accessor.count);
        let mut found = match accessor.buffer_view {
            Some(view) => {
                let stride = self.declared(view, place)?.byte_stride.unwrap_or(size);
                let data = self.view(view, place)?;
                let each = elements(data, [accessor.byte_offset, stride, size, count], place)?;
                self.spend(count.saturating_mul(size_of::<T>()), place)?;
                each.map(|bytes| convert(kind, bytes)).collect()
            }
            None => {
                // Zeros, of which a file has as many as it says, and few bytes where they are sparse.
                if count > self.length.max(MOST_ZEROS) {
                    return Err(ContentError::damaged(
                        place,
                        format!("{count} zeros, more than the file has bytes"),
                    ));
                }
                self.spend(count.saturating_mul(size_of::<T>()), place)?;
                vec![zero; count]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let part = |declared: &super::schema::SparsePart, size: usize| {
                let data = self.view(declared.buffer_view, place)?;
                elements(
                    data,
                    [declared.byte_offset, size, size, sparse.count],
                    place,
                )
            };
            let damaged = |why: &str| ContentError::damaged(place, why);
            let index = Kind::of_gltf(sparse.indices.component_type);
            let index = index.ok_or_else(|| damaged("sparse indices of no kind"))?;
            let values = part(&sparse.values, size)?;
            for (at, value) in part(&sparse.indices, index.size())?.zip(values) {
                let slot = index.whole(at).and_then(|at| found.get_mut(at as usize));
                *slot.ok_or_else(|| damaged("a sparse index beyond its elements"))? =
                    convert(kind, value);
            }
        }
        Ok(found)
    }

    /// `N` numbers an element; what a shorter element lacks is `fill`.
    pub fn floats<const N: usize>(
        &self,
        accessor: &Accessor,
        fill: [f32; N],
        place: &str,
    ) -> Result<Vec<[f32; N]>, ContentError> {
        let unit = Kind::of_gltf(accessor.component_type).map_or(1.0, Kind::unit);
        let unit = if accessor.normalized { unit } else { 1.0 };
        let convert = |kind: Kind, bytes: &[u8]| floats(kind, unit, bytes, fill);
        let found = self.elements(accessor, [0.0; N], convert, place)?;
        finite(&found, place)?;
        Ok(found)
    }

    /// One whole number an element.
    pub fn whole(&self, accessor: &Accessor, place: &str) -> Result<Vec<u32>, ContentError> {
        let convert = |kind: Kind, bytes: &[u8]| kind.whole(bytes);
        let found = self.elements(accessor, Some(0), convert, place)?;
        let found: Option<Vec<u32>> = found.into_iter().collect();
        found.ok_or_else(|| ContentError::damaged(place, "not all of it are whole numbers"))
    }
}

/// An element's numbers, divided by `unit`.
pub(crate) fn floats<const N: usize>(
    kind: Kind,
    unit: f64,
    bytes: &[u8],
    fill: [f32; N],
) -> [f32; N] {
    let mut element = fill;
    for (slot, bytes) in element.iter_mut().zip(bytes.chunks_exact(kind.size())) {
        *slot = match (kind, unit) {
            (Kind::F32, _) => kind.number(bytes) as f32,
            // The least number of a signed kind is beyond -1 by one step (glTF 2.0, 3.6.2.2).
            (_, unit) if unit > 1.0 => (kind.number(bytes) / unit).max(-1.0) as f32,
            _ => kind.number(bytes) as f32,
        };
    }
    element
}

/// An error unless all numbers are finite.
pub(crate) fn finite<const N: usize>(found: &[[f32; N]], place: &str) -> Result<(), ContentError> {
    match found.as_flattened().iter().all(|x| x.is_finite()) {
        true => Ok(()),
        false => Err(ContentError::damaged(place, "a number in it is not finite")),
    }
}

/// Kind of number and number of components of an accessor.
pub(crate) fn layout(accessor: &Accessor, place: &str) -> Result<(Kind, usize), ContentError> {
    let kind = Kind::of_gltf(accessor.component_type);
    let components = match accessor.shape.as_str() {
        "SCALAR" => Some(1),
        "VEC2" => Some(2),
        "VEC3" => Some(3),
        "VEC4" => Some(4),
        _ => None,
    };
    kind.zip(components).ok_or_else(|| {
        let Accessor {
            component_type,
            shape,
            ..
        } = accessor;
        ContentError::damaged(
            place,
            format!("{shape} of numbers of kind {component_type}"),
        )
    })
}

/// The object of an extension.
pub(crate) fn extension<T: DeserializeOwned>(
    extensions: &Extensions,
    name: &str,
    place: &str,
) -> Result<Option<T>, ContentError> {
    let Some(value) = extensions.get(name) else {
        return Ok(None);
    };
    let read = T::deserialize(value);
    (read.map(Some))
        .map_err(|why| ContentError::damaged(format!("{place}, {name}"), why.to_string()))
}

/// The JSON and the binary chunk of a .glb; a .gltf is all JSON.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ContentError> {
    const HEADER: usize = 12; // [byte]
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let version = u32_at(bytes, 4, "glb header")?;
    if version != 2 {
        let version = Fault::Version(version.to_string());
        return Err(ContentError::new("glb header", version));
    }
    let length = u32_at(bytes, 8, "glb header")? as usize;
    let file = bytes::part(bytes, 0, length, "glb")?;
    let (mut text, mut blob, mut at) = (None, None, HEADER);
    while at + 8 <= file.len() {
        let length = u32_at(file, at, "glb chunk")? as usize;
        let kind = &file[at + 4..at + 8];
        let data = part(file, at + 8, length, "glb chunk")?;
        match kind {
            b"JSON" if text.is_none() => text = Some(data),
            b"BIN\0" if blob.is_none() => blob = Some(data),
            _ => {}
        }
        at = at.saturating_add(8 + length);
    }
    let text = text.ok_or_else(|| ContentError::damaged("glb", "it has no JSON chunk"))?;
    Ok((text, blob))
}
