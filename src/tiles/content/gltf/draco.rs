//! Meshes that Draco compressed (`KHR_draco_mesh_compression`), read by `draco-oxide-decoder`.

use super::document::{Document, finite, floats};
use super::schema::Accessor;
use crate::tiles::content::bytes::{Kind, part};
use crate::tiles::content::error::ContentError;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A decoded mesh.
pub(crate) struct Mesh {
    /// Its corners, three a triangle.
    pub indices: Vec<u32>,
    /// Number of its points.
    pub count: usize,
    attributes: Vec<Attribute>,
}

/// An attribute of a decoded mesh: for each point where its value is, and the values.
struct Attribute {
    id: usize,
    kind: Kind,
    size: usize,
    values: Vec<u8>,
    value_of_point: Option<Vec<usize>>,
}

/// Numbers of vertices and faces as the header of a mesh has them (Draco bitstream 2.2, sections 4 to 6); zeros
/// where metadata stands before them.
fn counts(data: &[u8], place: &str) -> Result<[u64; 2], ContentError> {
    const HEADER: usize = 11; // [byte]
    const METADATA: u8 = 0x80; // of the flags' second byte
    let head = part(data, 0, HEADER, place)?;
    if head[10] & METADATA != 0 {
        return Ok([0; 2]);
    }
    // Edgebreaker begins with its kind of traversal.
    let mut rest = data[HEADER + usize::from(head[8] == 1)..].iter();
    let mut number = || {
        let bytes = rest.by_ref().take(5).enumerate();
        let mut number = 0;
        for (i, byte) in bytes {
            number |= u64::from(byte & 0x7f) << (7 * i);
            if byte & 0x80 == 0 {
                break;
            }
        }
        number
    };
    Ok([number(), number()])
}

impl Mesh {
    /// Decodes a mesh.
    pub fn new(document: &Document, data: &[u8], place: &str) -> Result<Self, ContentError> {
        /// Faces or vertices that a byte holds at most: real meshes take a bit or more for each.
        const DENSITY: u64 = 64;
        /// What the decoder needs for a face or vertex, roughly [byte].
        const WORK: usize = 64;
        let damaged = |why: &str| ContentError::damaged(place, why);
        if data.len() < 12 || !data.starts_with(b"DRACO") {
            return Err(damaged("it is no Draco data"));
        }
        let [first, second] = counts(data, place)?;
        let counted = first.max(second);
        if counted > DENSITY * data.len() as u64 {
            return Err(damaged("more faces than its bytes can hold"));
        }
        document.spend(WORK.saturating_mul(counted as usize), place)?;
        // A release that is still called alpha: what it does not foresee shall cost one tile, not the program.
        let decoded = catch_unwind(AssertUnwindSafe(|| draco_oxide_decoder::decode_mesh(data)));
        let mesh = match decoded {
            Ok(Ok(mesh)) => mesh,
            Ok(Err(why)) => return Err(damaged(&why.to_string())),
            Err(_) => return Err(damaged("the Draco decoder gave up on it")),
        };
        let mut count = None;
        let mut attributes = Vec::new();
        for attribute in mesh.get_attributes() {
            let kind = match attribute.get_component_type().get_id() {
                1 => Kind::I8,
                2 => Kind::U8,
                3 => Kind::I16,
                4 => Kind::U16,
                5 => Kind::I32,
                6 => Kind::U32,
                9 => Kind::F32,
                _ => return Err(damaged("an attribute's kind of number is not read")),
            };
            if count
                .replace(attribute.len())
                .is_some_and(|n| n != attribute.len())
            {
                return Err(damaged("its attributes are of different lengths"));
            }
            let map = attribute.point_map_as_slice();
            attributes.push(Attribute {
                id: attribute.get_id().as_usize(),
                kind,
                size: kind.size() * attribute.get_num_components(),
                values: attribute.get_data_as_bytes().to_vec(),
                value_of_point: map.map(|map| map.iter().map(|i| usize::from(*i)).collect()),
            });
        }
        let count = count.unwrap_or(0);
        let corners = mesh.get_faces().as_flattened();
        Ok(Self {
            indices: corners.iter().map(|i| usize::from(*i) as u32).collect(),
            count,
            attributes,
        })
    }

    /// Each point's value of an attribute through `convert`; the accessor says how it is meant.
    fn values<T>(
        &self,
        id: usize,
        convert: impl Fn(Kind, &[u8]) -> T,
        place: &str,
    ) -> Result<Vec<T>, ContentError> {
        let damaged = |why: String| ContentError::damaged(place, why);
        let found = self.attributes.iter().find(|a| a.id == id);
        let found = found.ok_or_else(|| damaged(format!("there is no Draco attribute {id}")))?;
        let value = |point: usize| {
            let at = match &found.value_of_point {
                None => point,
                Some(map) => *map.get(point)?,
            };
            let bytes = found.values.get(at.checked_mul(found.size)?..)?;
            Some(convert(found.kind, bytes.get(..found.size)?))
        };
        let values: Option<Vec<T>> = (0..self.count).map(value).collect();
        values.ok_or_else(|| damaged("a point without a value".into()))
    }

    /// `N` numbers a point; what an attribute lacks is `fill`.
    pub fn floats<const N: usize>(
        &self,
        id: usize,
        accessor: &Accessor,
        fill: [f32; N],
        place: &str,
    ) -> Result<Vec<[f32; N]>, ContentError> {
        let convert = |kind: Kind, bytes: &[u8]| {
            let unit = if accessor.normalized {
                kind.unit()
            } else {
                1.0
            };
            floats(kind, unit, bytes, fill)
        };
        let found = self.values(id, convert, place)?;
        finite(&found, place)?;
        Ok(found)
    }

    /// One whole number a point.
    pub fn whole(&self, id: usize, place: &str) -> Result<Vec<u32>, ContentError> {
        let found = self.values(id, |kind, bytes| kind.whole(bytes), place)?;
        let found: Option<Vec<u32>> = found.into_iter().collect();
        found.ok_or_else(|| ContentError::damaged(place, "not all of it are whole numbers"))
    }
}
