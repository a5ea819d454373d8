//! JSON with the place of each value, so that an error can name it.

use crate::tiles::error::TilesError;
use serde_json::{Map, Value};

/// A value in a file.
#[derive(Clone, Debug)]
pub(super) struct At<'a> {
    pub location: &'a str,
    pub path: String,
    pub value: &'a Value,
}

/// Reads a file's JSON; a byte order mark before it is passed over.
pub(super) fn parse(location: &str, bytes: &[u8]) -> Result<Value, TilesError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    serde_json::from_slice(bytes).map_err(|error| TilesError::Format {
        location: location.into(),
        place: format!("line {}, column {}", error.line(), error.column()),
        fault: format!("is no JSON that can be read ({error}); write the file again"),
    })
}

impl<'a> At<'a> {
    pub fn root(location: &'a str, value: &'a Value) -> Self {
        Self {
            location,
            path: String::new(),
            value,
        }
    }

    /// What is wrong here.
    pub fn fault(&self, fault: impl Into<String>) -> TilesError {
        TilesError::Format {
            location: self.location.into(),
            place: if self.path.is_empty() {
                "file".into()
            } else {
                self.path.clone()
            },
            fault: fault.into(),
        }
    }

    /// A member; `None` where there is none.
    pub fn get(&self, key: &str) -> Option<Self> {
        let value = self.value.get(key)?;
        let dot = if self.path.is_empty() { "" } else { "." };
        Some(Self {
            path: format!("{}{dot}{key}", self.path),
            value,
            location: self.location,
        })
    }

    /// A member that must be there.
    pub fn need(&self, key: &str) -> Result<Self, TilesError> {
        self.object()?;
        self.get(key)
            .ok_or_else(|| self.fault(format!("has no '{key}'; add it")))
    }

    pub fn object(&self) -> Result<&'a Map<String, Value>, TilesError> {
        self.value
            .as_object()
            .ok_or_else(|| self.fault("must be an object {…}"))
    }

    pub fn text(&self) -> Result<&'a str, TilesError> {
        self.value
            .as_str()
            .ok_or_else(|| self.fault("must be a text \"…\""))
    }

    pub fn number(&self) -> Result<f64, TilesError> {
        self.value
            .as_f64()
            .filter(|n| n.is_finite())
            .ok_or_else(|| self.fault("must be a number"))
    }

    /// A whole number within bounds.
    pub fn whole(&self, least: u64, most: u64) -> Result<u64, TilesError> {
        (self.value.as_u64())
            .filter(|n| (least..=most).contains(n))
            .ok_or_else(|| self.fault(format!("must be a whole number from {least} to {most}")))
    }

    /// The elements of an array.
    pub fn items(&self) -> Result<impl Iterator<Item = Self> + use<'a>, TilesError> {
        let items = self.value.as_array();
        let items = items.ok_or_else(|| self.fault("must be an array […]"))?;
        let (location, path) = (self.location, self.path.clone());
        Ok(items.iter().enumerate().map(move |(i, value)| Self {
            location,
            path: format!("{path}[{i}]"),
            value,
        }))
    }

    /// An array of so many numbers.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N], TilesError> {
        let numbers: Vec<f64> = self
            .items()?
            .take(N + 1)
            .map(|item| item.number())
            .collect::<Result<_, _>>()?;
        <[f64; N]>::try_from(numbers)
            .map_err(|_| self.fault(format!("must be an array of {N} numbers")))
    }
}
