//! Meshes that Draco compressed (`KHR_draco_mesh_compression`), read by `draco-oxide-decoder`.

use super::document::{Document, finite, floats};
use super::schema::Accessor;
use crate::tiles::content::bytes::Kind;
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

/// The beginning of a mesh's data, read before the decoder sees it: it allocates what the data ask for.
struct Head<'d> {
    rest: &'d [u8],
}

impl Head<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(*first)
    }

    fn skip(&mut self, bytes: u64) -> Option<()> {
        self.rest = self.rest.get(usize::try_from(bytes).ok()?..)?;
        Some(())
    }

    /// A number of seven bits a byte, the lowest first (LEB128).
    fn number(&mut self) -> Option<u64> {
        let mut number = 0;
        for shift in (0..63).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(number);
            }
        }
        None
    }

    fn name(&mut self) -> Option<()> {
        let length = self.byte()?;
        self.skip(length.into())
    }

    /// Skips a block of metadata and those inside it.
    fn metadata(&mut self, depth: usize) -> Option<()> {
        for _ in 0..self.number()? {
            self.name()?;
            let length = self.number()?;
            self.skip(length)?;
        }
        for _ in 0..self.number()? {
            self.name()?;
            self.metadata(depth.checked_sub(1)?)?;
        }
        Some(())
    }

    /// The largest count that the header and the connectivity's beginning have (Draco bitstream 2.2, 4.1 to 4.8).
    fn largest_count(data: &[u8]) -> Option<u64> {
        const HEADER: usize = 11; // [byte]
        const METADATA: u8 = 0x80; // of the flags' second byte
        const DEPTH: usize = 32; // of metadata inside metadata
        let mut head = Head {
            rest: data.get(HEADER..)?,
        };
        if data[10] & METADATA != 0 {
            for _ in 0..head.number()? {
                head.number()?;
                head.metadata(DEPTH)?;
            }
            head.metadata(DEPTH)?;
        }
        let edgebreaker = data[8] == 1;
        if !edgebreaker {
            return Some(head.number()?.max(head.number()?));
        }
        head.byte()?; // the kind of traversal
        let (vertices, faces) = (head.number()?, head.number()?);
        head.byte()?; // the number of attributes with seams
        let (symbols, split_symbols, splits) = (head.number()?, head.number()?, head.number()?);
        [vertices, faces, symbols, split_symbols, splits]
            .into_iter()
            .max()
    }
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
        let counted = Head::largest_count(data).ok_or_else(|| damaged("its header ends early"))?;
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
