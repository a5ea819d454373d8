//! Feature and batch tables of 3D Tiles 1.0: JSON whose entries are values or places in binary data.

use crate::tiles::content::bytes::{Kind, elements, json, part};
use crate::tiles::content::draco::{self, Attribute};
use crate::tiles::content::error::ContentError;
use crate::tiles::content::model::{Context, Rows};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// The extension `3DTILES_draco_point_compression` of a feature table.
const DRACO: &str = "3DTILES_draco_point_compression";

/// What that says: which attribute is which entry, and where the data lie.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Compressed {
    properties: BTreeMap<String, usize>,
    byte_offset: usize,
    byte_length: usize,
}

/// A feature or batch table.
pub(crate) struct Table<'b> {
    entries: Map<String, Value>,
    binary: &'b [u8],
    /// Entries that were compressed.
    unpacked: BTreeMap<String, Attribute>,
    place: &'static str,
}

impl<'b> Table<'b> {
    /// Reads its JSON; without any it is empty.
    pub fn new(text: &[u8], binary: &'b [u8], place: &'static str) -> Result<Self, ContentError> {
        let blank = text.iter().all(|b| *b == 0 || b.is_ascii_whitespace());
        let entries = if blank {
            Map::new()
        } else {
            json(text, place)?
        };
        Ok(Self {
            entries,
            binary,
            unpacked: BTreeMap::new(),
            place,
        })
    }

    /// Whether it says nothing.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Whether it says yes to something.
    pub fn flag(&self, name: &str) -> bool {
        self.entries
            .get(name)
            .and_then(Value::as_bool)
            .unwrap_or(false)
    }

    /// Unpacks the entries that Draco compressed: attributes of `count` points.
    pub fn unpack(&mut self, count: usize, context: &Context) -> Result<(), ContentError> {
        let extensions = self.entries.get("extensions");
        let Some(said) = extensions.and_then(|all| all.get(DRACO)) else {
            return Ok(());
        };
        let said = Compressed::deserialize(said).map_err(|why| self.fault(DRACO, why))?;
        let place = format!("{}, {DRACO}", self.place);
        let data = part(self.binary, said.byte_offset, said.byte_length, &place)?;
        let mut points = draco::cloud(data, context, &place)?;
        if points.count != count {
            let why = format!("{} points where {count} were expected", points.count);
            return Err(self.fault(DRACO, why));
        }
        for (name, id) in said.properties {
            let own = points.attributes.remove(&id);
            self.unpacked
                .insert(name, own.ok_or_else(|| draco::absent(id, &place))?);
        }
        Ok(())
    }

    /// A fault of an entry.
    fn fault(&self, name: &str, why: impl std::fmt::Display) -> ContentError {
        ContentError::damaged(format!("{}, {name}", self.place), why.to_string())
    }

    /// A whole number for the table as a whole.
    pub fn count(&self, name: &str) -> Result<Option<usize>, ContentError> {
        let count = self.numbers(name, 1, Kind::U32, 1)?;
        let whole = |n: f64| n >= 0.0 && n <= f64::from(u32::MAX) && n.fract() == 0.0;
        match count.as_deref() {
            None => Ok(None),
            Some([n]) if whole(*n) => Ok(Some(*n as usize)),
            Some(other) => Err(self.fault(name, format!("{other:?} is no count"))),
        }
    }

    /// Three numbers for the table as a whole.
    pub fn vector(&self, name: &str, kind: Kind) -> Result<Option<[f64; 3]>, ContentError> {
        let found = self.numbers(name, 3, kind, 1)?;
        let Some(found) = found else { return Ok(None) };
        let vector = <[f64; 3]>::try_from(found).ok();
        let vector = vector.filter(|v| v.iter().all(|x| x.is_finite()));
        (vector.map(Some)).ok_or_else(|| self.fault(name, "three finite numbers were expected"))
    }

    /// Numbers, `components` for each of `count` elements; `kind` where the table names none.
    pub fn numbers(
        &self,
        name: &str,
        components: usize,
        kind: Kind,
        count: usize,
    ) -> Result<Option<Vec<f64>>, ContentError> {
        if let Some(found) = self.unpacked.get(name) {
            if found.components != components {
                return Err(self.fault(name, format!("{components} numbers a point were expected")));
            }
            let numbers = found.bytes.chunks_exact(found.kind.size());
            return Ok(Some(
                numbers.map(|bytes| found.kind.number(bytes)).collect(),
            ));
        }
        let Some(entry) = self.entries.get(name) else {
            return Ok(None);
        };
        let all = count.saturating_mul(components);
        let listed = match entry {
            Value::Object(entry) => return self.binary(name, entry, components, kind, count),
            Value::Array(list) => list.iter().map(Value::as_f64).collect(),
            one => one.as_f64().map(|one| vec![one]),
        };
        let listed = listed.filter(|list| list.len() == all);
        (listed.map(Some)).ok_or_else(|| self.fault(name, format!("{all} numbers were expected")))
    }

    /// The same, where they lie in the binary part.
    fn binary(
        &self,
        name: &str,
        entry: &Map<String, Value>,
        components: usize,
        kind: Kind,
        count: usize,
    ) -> Result<Option<Vec<f64>>, ContentError> {
        let (kind, at) = self.reference(name, entry, Some(kind))?;
        let size = kind.size();
        let place = format!("{}, {name}", self.place);
        let all = count.saturating_mul(components);
        let each = elements(self.binary, [at, size, size, all], &place)?;
        Ok(Some(each.map(|bytes| kind.number(bytes)).collect()))
    }

    /// Kind and offset of an entry in the binary part.
    fn reference(
        &self,
        name: &str,
        entry: &Map<String, Value>,
        kind: Option<Kind>,
    ) -> Result<(Kind, usize), ContentError> {
        let named = entry.get("componentType");
        let kind = match named {
            None => kind,
            Some(named) => named.as_str().and_then(Kind::of_table),
        };
        let kind = kind.ok_or_else(|| self.fault(name, "its componentType is none"))?;
        let at = entry.get("byteOffset").and_then(Value::as_u64);
        let at = at.ok_or_else(|| self.fault(name, "its byteOffset is no number"))?;
        Ok((kind, usize::try_from(at).unwrap_or(usize::MAX)))
    }

    /// What a batch table knows of each of `count` features, and notes of what was left out. A feature takes at
    /// least one of the tile's `bytes`.
    pub fn rows(
        &self,
        count: usize,
        bytes: usize,
        context: &Context,
    ) -> Result<(Rows, Vec<String>), ContentError> {
        if count > bytes {
            let why = format!("{count} features in {bytes} bytes");
            return Err(ContentError::damaged(self.place, why));
        }
        const ROW: usize = 64; // [byte], and for each of its values
        let values = count.saturating_mul(self.entries.len() + 1);
        context.spend(values.saturating_mul(ROW), self.place)?;
        let mut rows = vec![Map::new(); count];
        let mut notes = Vec::new();
        for (name, entry) in &self.entries {
            match entry {
                _ if name == "extras" => {}
                _ if name == "extensions" || name == "HIERARCHY" => {
                    let names = entry.as_object().into_iter().flat_map(Map::keys);
                    let names: Vec<_> = names.map(String::as_str).collect();
                    notes.push(match name.as_str() {
                        "HIERARCHY" => "the batch table's hierarchy is left out".to_owned(),
                        _ => format!("left out of the batch table: {}", names.join(", ")),
                    });
                }
                Value::Array(list) if list.len() >= count => {
                    for (row, value) in rows.iter_mut().zip(list) {
                        row.insert(name.clone(), value.clone());
                    }
                }
                Value::Array(list) => {
                    let why = format!("{} values for {count} features", list.len());
                    return Err(self.fault(name, why));
                }
                Value::Object(entry) => self.column(name, entry, &mut rows)?,
                _ => return Err(self.fault(name, "neither a list nor a place in binary data")),
            }
        }
        Ok((rows, notes))
    }

    /// Fills a column of rows from the binary part.
    fn column(
        &self,
        name: &str,
        entry: &Map<String, Value>,
        rows: &mut [Map<String, Value>],
    ) -> Result<(), ContentError> {
        let (kind, at) = self.reference(name, entry, None)?;
        let components = match entry.get("type").and_then(Value::as_str) {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            _ => return Err(self.fault(name, "its type is none of SCALAR, VEC2, VEC3, VEC4")),
        };
        let size = kind.size() * components;
        let place = format!("{}, {name}", self.place);
        let each = elements(self.binary, [at, size, size, rows.len()], &place)?;
        for (row, bytes) in rows.iter_mut().zip(each) {
            let mut values = bytes.chunks(kind.size()).map(|bytes| kind.json(bytes));
            let value = match components {
                1 => values.next().unwrap_or_default(),
                _ => Value::Array(values.collect()),
            };
            row.insert(name.to_owned(), value);
        }
        Ok(())
    }
}

/// The parts of a tile of 3D Tiles 1.0.
pub(crate) struct Parts<'b> {
    /// The feature table.
    pub features: Table<'b>,
    /// The batch table.
    pub batch: Table<'b>,
    /// What follows the tables.
    pub body: &'b [u8],
}

impl<'b> Parts<'b> {
    /// Splits what follows a header of `start` bytes by the lengths of both tables' JSON and binary parts [byte].
    pub fn new(
        bytes: &'b [u8],
        start: usize,
        lengths: [u32; 4],
        place: &str,
    ) -> Result<Self, ContentError> {
        let mut at = start;
        let mut parts = [&bytes[..0]; 4];
        for (slot, length) in parts.iter_mut().zip(lengths) {
            *slot = part(bytes, at, length as usize, place)?;
            at += length as usize;
        }
        Ok(Self {
            features: Table::new(parts[0], parts[1], "feature table")?,
            batch: Table::new(parts[2], parts[3], "batch table")?,
            body: &bytes[at..],
        })
    }
}
