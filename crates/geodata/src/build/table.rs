//! The properties of a tile's features as a property table (EXT_structural_metadata; 3D Metadata Specification 1.0).

use super::mesh::{Mesh, NO_FEATURE};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// The features that a tile shows.
pub(super) struct Table<'a> {
    /// Rows of the whole scene's table, in order.
    rows: Vec<u32>,
    /// Columns by the names that sources give them, with the identifiers that the format asks for.
    columns: Vec<Column<'a>>,
}

/// One property of all features.
struct Column<'a> {
    id: String,
    name: &'a str,
    kind: Kind,
    values: Vec<Option<&'a Value>>,
}

/// What a column holds.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Boolean,
    Integer,
    Number,
    Text,
}

/// Stands for a number that is missing.
const NO_INTEGER: i32 = i32::MIN;
/// Stands for a number that is missing.
const NO_NUMBER: f64 = f64::MIN;

impl<'a> Table<'a> {
    /// The table of the features that a mesh shows.
    pub fn of(features: &'a [Map<String, Value>], mesh: &Mesh) -> Self {
        let used = |&i: &u32| Some(mesh.vertices[i as usize].feature).filter(|&f| f != NO_FEATURE);
        let mut rows: Vec<u32> = mesh.indices.iter().filter_map(used).collect();
        rows.sort_unstable();
        rows.dedup();
        let mut names: BTreeMap<&str, Vec<Option<&Value>>> = BTreeMap::new();
        for (k, &row) in rows.iter().enumerate() {
            for (name, value) in features.get(row as usize).into_iter().flatten() {
                let column = names.entry(name).or_insert_with(|| vec![None; rows.len()]);
                column[k] = Some(value).filter(|value| !value.is_null());
            }
        }
        let mut columns: Vec<Column> = Vec::new();
        for (name, values) in names {
            let taken = |id: &str, columns: &[Column]| columns.iter().any(|c| c.id == id);
            let mut id = identifier(name);
            while taken(&id, &columns) {
                id.push('_');
            }
            let kind = Kind::of(&values);
            columns.push(Column {
                id,
                name,
                kind,
                values,
            });
        }
        Self { rows, columns }
    }

    /// Number of features.
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Whether anything is known of them.
    pub fn has_columns(&self) -> bool {
        !self.columns.is_empty()
    }

    /// The row of a feature of the scene.
    pub fn row(&self, feature: u32) -> usize {
        self.rows.binary_search(&feature).unwrap_or_default()
    }

    /// The extension's value; `store` keeps bytes in the binary chunk and says in which buffer view.
    pub fn encoded(&self, mut store: impl FnMut(&[u8]) -> usize) -> Value {
        let mut schema = Map::new();
        let mut table = Map::new();
        for column in &self.columns {
            let mut property = match column.kind {
                Kind::Boolean => json!({ "type": "BOOLEAN" }),
                Kind::Integer => json!({ "type": "SCALAR", "componentType": "INT32" }),
                Kind::Number => json!({ "type": "SCALAR", "componentType": "FLOAT64" }),
                Kind::Text => json!({ "type": "STRING" }),
            };
            if column.values.iter().any(Option::is_none) {
                property["noData"] = match column.kind {
                    Kind::Integer => json!(NO_INTEGER),
                    Kind::Number => json!(NO_NUMBER),
                    Kind::Boolean | Kind::Text => json!(""),
                };
            }
            if column.id != column.name {
                property["name"] = json!(column.name);
            }
            schema.insert(column.id.clone(), property);
            table.insert(column.id.clone(), column.encoded(&mut store));
        }
        json!({
            "schema": { "id": "features", "classes": { "feature": { "properties": schema } } },
            "propertyTables": [{ "class": "feature", "count": self.count(), "properties": table }],
        })
    }
}

impl Kind {
    /// The narrowest kind that holds all values.
    fn of(values: &[Option<&Value>]) -> Self {
        let present = || values.iter().flatten();
        let integer = |value: &&&Value| {
            let small = |x| i32::try_from(x).is_ok_and(|x| x != NO_INTEGER);
            value.as_i64().is_some_and(small)
        };
        if values.iter().all(|v| v.is_some_and(Value::is_boolean)) {
            Self::Boolean
        } else if present().all(|value| integer(&value)) && present().next().is_some() {
            Self::Integer
        } else if present().all(|value| value.is_number()) && present().next().is_some() {
            Self::Number
        } else {
            Self::Text
        }
    }
}

impl Column<'_> {
    /// The column's entry in the table.
    fn encoded(&self, store: &mut impl FnMut(&[u8]) -> usize) -> Value {
        match self.kind {
            Kind::Boolean => {
                let mut bits = vec![0_u8; self.values.len().div_ceil(8)];
                for (k, value) in self.values.iter().enumerate() {
                    let set = value.and_then(Value::as_bool).unwrap_or_default();
                    bits[k / 8] |= u8::from(set) << (k % 8);
                }
                json!({ "values": store(&bits) })
            }
            Kind::Integer => {
                let number = |value: &Option<&Value>| {
                    let x = value.and_then(Value::as_i64);
                    x.and_then(|x| i32::try_from(x).ok()).unwrap_or(NO_INTEGER)
                };
                let bytes = self.values.iter().flat_map(|v| number(v).to_le_bytes());
                json!({ "values": store(&bytes.collect::<Vec<_>>()) })
            }
            Kind::Number => {
                let number =
                    |value: &Option<&Value>| value.and_then(Value::as_f64).unwrap_or(NO_NUMBER);
                let bytes = self.values.iter().flat_map(|v| number(v).to_le_bytes());
                json!({ "values": store(&bytes.collect::<Vec<_>>()) })
            }
            Kind::Text => {
                let mut text = String::new();
                let mut offsets = vec![0_u32];
                for value in &self.values {
                    match value {
                        None => {}
                        Some(Value::String(plain)) => text.push_str(plain),
                        Some(other) => text.push_str(&other.to_string()),
                    }
                    offsets.push(text.len() as u32);
                }
                let bytes: Vec<u8> = offsets.iter().flat_map(|x| x.to_le_bytes()).collect();
                // A view of no bytes is not allowed.
                if text.is_empty() {
                    text.push(' ');
                }
                json!({
                    "values": store(text.as_bytes()), "stringOffsets": store(&bytes), "stringOffsetType": "UINT32",
                })
            }
        }
    }
}

/// A name as identifiers of a schema are spelled: letters, digits and underscores, no digit first.
fn identifier(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let id: String = name.chars().map(plain).collect();
    match id.chars().next() {
        Some(first) if !first.is_ascii_digit() => id,
        _ => format!("_{id}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::mesh::Vertex;

    #[test]
    fn columns_take_the_narrowest_kind_that_holds_their_values() {
        let rows = [
            json!({"a": 1, "b": 1.5, "c": "x", "d": true, "e": 1, "1 f": [1]}),
            json!({"a": 2, "b": 2, "c": "y", "d": false, "e": "z"}),
        ];
        let features: Vec<_> = rows.iter().filter_map(|v| v.as_object().cloned()).collect();
        let corner = |feature| Vertex {
            feature,
            ..Vertex::default()
        };
        let mesh = Mesh {
            vertices: vec![corner(0), corner(1), corner(NO_FEATURE)],
            indices: vec![0, 1, 2],
        };
        let table = Table::of(&features, &mesh);
        let mut stored = Vec::new();
        let value = table.encoded(|bytes| {
            stored.push(bytes.to_vec());
            stored.len() - 1
        });
        let properties = &value["schema"]["classes"]["feature"]["properties"];
        assert_eq!(properties["a"]["componentType"], "INT32");
        assert_eq!(properties["b"]["componentType"], "FLOAT64");
        assert_eq!(properties["c"]["type"], "STRING");
        assert_eq!(properties["d"]["type"], "BOOLEAN");
        assert_eq!(properties["e"]["type"], "STRING");
        assert_eq!(properties["_1_f"]["name"], "1 f");
        assert_eq!(properties["_1_f"]["noData"], "");
        let column = |id: &str| {
            let index = value["propertyTables"][0]["properties"][id]["values"].as_u64();
            stored[index.unwrap_or_default() as usize].clone()
        };
        assert_eq!(column("a"), [1, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(column("d"), [1]);
        assert_eq!(column("e"), b"1z");
    }
}
