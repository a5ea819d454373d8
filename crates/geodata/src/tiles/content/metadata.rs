//! Property tables (3D Metadata Specification 1.1; `EXT_structural_metadata`): binary columns as rows of JSON.

use crate::tiles::content::bytes::Kind;
use crate::tiles::content::error::ContentError;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// A schema: what classes of things there are, and their properties.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Schema {
    classes: BTreeMap<String, Class>,
    enums: BTreeMap<String, Enum>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Class {
    properties: BTreeMap<String, Property>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Property {
    #[serde(rename = "type")]
    shape: String,
    component_type: Option<String>,
    enum_type: Option<String>,
    array: bool,
    count: Option<usize>,
    normalized: bool,
    offset: Option<Value>,
    scale: Option<Value>,
    no_data: Option<Value>,
    default: Option<Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Enum {
    value_type: Option<String>,
    values: Vec<EnumValue>,
}

#[derive(Debug, Deserialize)]
struct EnumValue {
    name: String,
    value: i64,
}

/// Gives a buffer view by its number; the text says what wants it.
pub(crate) type Views<'v> = dyn Fn(usize, &str) -> Result<&'v [u8], ContentError> + 'v;

/// A property table.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct PropertyTable {
    class: String,
    /// Number of its rows.
    pub count: usize,
    properties: BTreeMap<String, Column>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Column {
    values: usize,
    array_offsets: Option<usize>,
    string_offsets: Option<usize>,
    array_offset_type: Option<String>,
    string_offset_type: Option<String>,
    offset: Option<Value>,
    scale: Option<Value>,
}

impl PropertyTable {
    /// What its rows need at least when they are read [byte].
    pub fn size(&self) -> usize {
        const ROW: usize = 64; // [byte], and for each of its values
        let values = self.properties.len().saturating_add(1);
        self.count.saturating_mul(values).saturating_mul(ROW)
    }

    /// Its rows: by name of the property what each thing has; `view` gives a buffer view.
    pub fn rows<'v>(
        &self,
        schema: &Schema,
        view: &Views<'v>,
        place: &str,
    ) -> Result<Vec<Map<String, Value>>, ContentError> {
        let class = schema.classes.get(&self.class);
        let absent = || {
            let why = format!("its schema has no class {:?}", self.class);
            ContentError::damaged(place, why)
        };
        let class = class.ok_or_else(absent)?;
        let mut rows = vec![Map::new(); self.count];
        for (name, property) in &class.properties {
            let place = format!("{place}, {name}");
            match self.properties.get(name) {
                Some(column) => {
                    let reader = Reader::new(schema, property, column, view, &place)?;
                    reader.fill(name, &mut rows, &place)?;
                }
                None => {
                    let Some(default) = &property.default else {
                        continue;
                    };
                    for row in &mut rows {
                        row.insert(name.clone(), default.clone());
                    }
                }
            }
        }
        Ok(rows)
    }
}

/// How an element of a column is stored.
enum Element<'s, 'v> {
    Numbers(Kind, usize),
    Boolean,
    Text(Offsets<'v>),
    Enum(Kind, &'s Enum),
}

/// Where each thing's part of a column begins; the next one's beginning is its end.
struct Offsets<'v> {
    kind: Kind,
    data: &'v [u8],
}

impl<'v> Offsets<'v> {
    fn new(data: Option<&'v [u8]>, kind: Option<&str>, place: &str) -> Result<Self, ContentError> {
        let kind = Kind::of_metadata(kind.unwrap_or("UINT32"));
        let found = data.zip(kind).map(|(data, kind)| Self { kind, data });
        found.ok_or_else(|| ContentError::damaged(place, "its offsets are missing"))
    }

    /// First and end of a thing's part.
    fn part(&self, index: usize) -> Option<(usize, usize)> {
        let size = self.kind.size();
        let at = |i: usize| {
            let bytes = self.data.get(i.checked_mul(size)?..)?.get(..size)?;
            Some(self.kind.whole(bytes)? as usize)
        };
        let (first, end) = (at(index)?, at(index.checked_add(1)?)?);
        (first <= end).then_some((first, end))
    }
}

/// A column about to be read.
struct Reader<'s, 'v> {
    property: &'s Property,
    element: Element<'s, 'v>,
    values: &'v [u8],
    arrays: Option<Offsets<'v>>,
    scale: Option<&'s Value>,
    offset: Option<&'s Value>,
}

impl<'s, 'v> Reader<'s, 'v> {
    fn new(
        schema: &'s Schema,
        property: &'s Property,
        column: &'s Column,
        view: &Views<'v>,
        place: &str,
    ) -> Result<Self, ContentError> {
        let damaged = |why: String| ContentError::damaged(place, why);
        let offsets = |index: Option<usize>, kind: &Option<String>| {
            let data = index.map(|index| view(index, place)).transpose()?;
            Offsets::new(data, kind.as_deref(), place)
        };
        let components = match property.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" | "MAT2" => 4,
            "MAT3" => 9,
            "MAT4" => 16,
            _ => 0,
        };
        let element = match property.shape.as_str() {
            "STRING" => Element::Text(offsets(column.string_offsets, &column.string_offset_type)?),
            "BOOLEAN" => Element::Boolean,
            "ENUM" => {
                let name = property.enum_type.as_deref().unwrap_or_default();
                let found = schema.enums.get(name);
                let found = found.ok_or_else(|| damaged(format!("there is no enum {name:?}")))?;
                let kind = Kind::of_metadata(found.value_type.as_deref().unwrap_or("UINT16"));
                Element::Enum(
                    kind.ok_or_else(|| damaged("an enum of no kind".into()))?,
                    found,
                )
            }
            _ => {
                let name = property.component_type.as_deref().unwrap_or_default();
                let kind = Kind::of_metadata(name).filter(|_| components > 0);
                let unknown = || damaged(format!("{} of {name:?}", property.shape));
                Element::Numbers(kind.ok_or_else(unknown)?, components)
            }
        };
        let arrays = match (property.array, property.count) {
            (true, None) => Some(offsets(column.array_offsets, &column.array_offset_type)?),
            _ => None,
        };
        Ok(Self {
            property,
            element,
            values: view(column.values, place)?,
            arrays,
            scale: column.scale.as_ref().or(property.scale.as_ref()),
            offset: column.offset.as_ref().or(property.offset.as_ref()),
        })
    }

    /// Adds the column to rows.
    fn fill(
        &self,
        name: &str,
        rows: &mut [Map<String, Value>],
        place: &str,
    ) -> Result<(), ContentError> {
        for (index, row) in rows.iter_mut().enumerate() {
            let short = || ContentError::damaged(place, format!("row {index} is not in its data"));
            let raw = self.raw(index).ok_or_else(short)?;
            let value = match &self.property.no_data {
                Some(no_data) if *no_data == raw => self.property.default.clone(),
                _ => Some(self.scaled(raw)),
            };
            if let Some(value) = value {
                row.insert(name.to_owned(), value);
            }
        }
        Ok(())
    }

    /// What a row has, as it is stored.
    fn raw(&self, row: usize) -> Option<Value> {
        let (first, end) = match (&self.arrays, self.property.array, self.property.count) {
            (Some(arrays), ..) => arrays.part(row)?,
            (None, true, Some(count)) => {
                let first = row.checked_mul(count)?;
                (first, first.checked_add(count)?)
            }
            _ => return self.one(row),
        };
        // An element takes a bit or more.
        if end - first > self.values.len().saturating_mul(8) {
            return None;
        }
        (first..end)
            .map(|i| self.one(i))
            .collect::<Option<_>>()
            .map(Value::Array)
    }

    /// An element.
    fn one(&self, index: usize) -> Option<Value> {
        let numbers = |size: usize| self.values.get(index.checked_mul(size)?..)?.get(..size);
        Some(match &self.element {
            Element::Numbers(kind, 1) => kind.json(numbers(kind.size())?),
            Element::Numbers(kind, components) => {
                let bytes = numbers(kind.size() * components)?;
                let each = bytes.chunks(kind.size()).map(|bytes| kind.json(bytes));
                Value::Array(each.collect())
            }
            Element::Boolean => Value::Bool(self.values.get(index / 8)? >> (index % 8) & 1 == 1),
            Element::Text(offsets) => {
                let (first, end) = offsets.part(index)?;
                let text = self.values.get(first..end)?;
                Value::String(String::from_utf8_lossy(text).into_owned())
            }
            Element::Enum(kind, names) => {
                let number = kind.json(numbers(kind.size())?);
                let named = |v: &&EnumValue| number.as_i64() == Some(v.value);
                let found = names.values.iter().find(named);
                found.map_or(number.clone(), |found| found.name.clone().into())
            }
        })
    }

    /// A stored value as it is meant: normalized, scaled and shifted.
    fn scaled(&self, raw: Value) -> Value {
        let Element::Numbers(kind, _) = self.element else {
            return raw;
        };
        let unit = if self.property.normalized {
            kind.unit()
        } else {
            1.0
        };
        if unit == 1.0 && self.scale.is_none() && self.offset.is_none() {
            return raw;
        }
        scaled(&raw, unit, self.scale, self.offset)
    }
}

/// value / unit · scale + offset, component by component.
fn scaled(raw: &Value, unit: f64, scale: Option<&Value>, offset: Option<&Value>) -> Value {
    match raw {
        Value::Array(list) => {
            let each = list.iter().enumerate().map(|(i, value)| {
                // A row's array of vectors has one scale for all of them, or one for each.
                let of = |v: &'_ Option<&Value>| match v {
                    Some(Value::Array(all)) => all.get(i).cloned(),
                    other => other.cloned(),
                };
                scaled(value, unit, of(&scale).as_ref(), of(&offset).as_ref())
            });
            Value::Array(each.collect())
        }
        raw => {
            let number = |v: Option<&Value>, other: f64| v.and_then(Value::as_f64).unwrap_or(other);
            let stored = raw.as_f64().unwrap_or(f64::NAN) / unit;
            let stored = if unit > 1.0 { stored.max(-1.0) } else { stored };
            (stored * number(scale, 1.0) + number(offset, 0.0)).into()
        }
    }
}
