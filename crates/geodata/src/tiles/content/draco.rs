//! Meshes and point clouds that Draco compressed, read by `draco-core`.

use crate::tiles::content::bytes::Kind;
use crate::tiles::content::error::ContentError;
use crate::tiles::content::model::Context;
use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointCloud,
    PointCloudDecoder, PointIndex, Status,
};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What is known of each point.
pub(crate) struct Points {
    /// How many there are.
    pub count: usize,
    /// The attributes by their numbers.
    pub attributes: BTreeMap<usize, Attribute>,
}

/// An attribute, point by point.
pub(crate) struct Attribute {
    /// The kind of its numbers.
    pub kind: Kind,
    /// Numbers a point.
    pub components: usize,
    /// The numbers of all points, little-endian.
    pub bytes: Vec<u8>,
}

impl Points {
    fn new(cloud: &PointCloud, context: &Context, place: &str) -> Result<Self, ContentError> {
        let count = cloud.num_points();
        let mut attributes = BTreeMap::new();
        for attribute in (0..cloud.num_attributes()).map(|i| cloud.attribute(i)) {
            let own = Attribute::new(attribute, count, context, place)?;
            attributes.insert(attribute.unique_id() as usize, own);
        }
        Ok(Self { count, attributes })
    }
}

/// The error of a number that no attribute has.
pub(crate) fn absent(id: usize, place: &str) -> ContentError {
    ContentError::damaged(place, format!("there is no Draco attribute {id}"))
}

impl Attribute {
    fn new(
        attribute: &PointAttribute,
        count: usize,
        context: &Context,
        place: &str,
    ) -> Result<Self, ContentError> {
        let damaged = |why| ContentError::damaged(place, why);
        let kind = match attribute.data_type() {
            DataType::Int8 => Kind::I8,
            DataType::Uint8 => Kind::U8,
            DataType::Int16 => Kind::I16,
            DataType::Uint16 => Kind::U16,
            DataType::Int32 => Kind::I32,
            DataType::Uint32 => Kind::U32,
            DataType::Float32 => Kind::F32,
            DataType::Float64 => Kind::F64,
            _ => return Err(damaged("an attribute's kind of number is not read")),
        };
        let components = usize::from(attribute.num_components());
        let size = components * kind.size();
        context.spend(count.saturating_mul(size), place)?;
        let values = attribute.buffer().data();
        let mut bytes = Vec::with_capacity(count * size);
        for point in 0..count {
            let at = attribute.mapped_index(PointIndex(point as u32)).0 as usize * size;
            let value = values.get(at..at + size);
            bytes.extend(value.ok_or_else(|| damaged("a point without a value"))?);
        }
        Ok(Self {
            kind,
            components,
            bytes,
        })
    }

    /// Its bytes, a point at a time.
    pub fn points(&self) -> impl Iterator<Item = &[u8]> {
        let size = self.components * self.kind.size();
        self.bytes.chunks_exact(size.max(1))
    }
}

/// A mesh's corners, three a triangle, and its points.
pub(crate) fn mesh(
    data: &[u8],
    context: &Context,
    place: &str,
) -> Result<(Vec<u32>, Points), ContentError> {
    let mesh: Mesh = decoded(data, context, place, |buffer, mesh| {
        MeshDecoder::new().decode(buffer, mesh)
    })?;
    context.spend(mesh.num_faces().saturating_mul(12), place)?;
    let corners = mesh.faces().iter().flatten().map(|point| point.0);
    Ok((corners.collect(), Points::new(&mesh, context, place)?))
}

/// A cloud's points.
pub(crate) fn cloud(data: &[u8], context: &Context, place: &str) -> Result<Points, ContentError> {
    let cloud = decoded(data, context, place, |buffer, cloud| {
        PointCloudDecoder::new().decode(buffer, cloud)
    })?;
    Points::new(&cloud, context, place)
}

/// What a decoder makes of data, within what the content may still decode to.
fn decoded<T: Default>(
    data: &[u8],
    context: &Context,
    place: &str,
    decode: impl Fn(&mut DecoderBuffer, &mut T) -> Status,
) -> Result<T, ContentError> {
    /// What the decoder needs for a point and for a face beside the attributes, roughly [byte].
    const POINT: u64 = 16;
    const FACE: u64 = 64;
    let left = context.left();
    let limits = DecodeLimits::default()
        .with_max_points(left / POINT)
        .with_max_faces(left / FACE)
        .with_max_decoded_bytes(left);
    let damaged = |why: &str| ContentError::damaged(place, why);
    // What the decoder does not foresee shall cost one tile, not the program.
    let result = catch_unwind(AssertUnwindSafe(|| {
        let mut found = T::default();
        let mut buffer = DecoderBuffer::new(data).with_limits(limits);
        decode(&mut buffer, &mut found).map(|()| found)
    }));
    match result {
        Ok(Ok(found)) => Ok(found),
        Ok(Err(why)) => Err(damaged(&why.to_string())),
        Err(_) => Err(damaged("the Draco decoder gave up on it")),
    }
}
