//! Members of JSON that may be null, absent or of another type than they should: they are then empty, and only broken JSON is an error.

use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

/// What takes any JSON.
trait Tolerant<'de>: Sized {
    /// Its value for what it does not understand.
    fn odd() -> Self;
    fn number(_: f64) -> Self {
        Self::odd()
    }
    fn text(_: &str) -> Self {
        Self::odd()
    }
    fn list<A: SeqAccess<'de>>(mut list: A) -> Result<Self, A::Error> {
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Self::odd())
    }
    fn table<A: MapAccess<'de>>(mut table: A) -> Result<Self, A::Error> {
        while table.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(Self::odd())
    }
}

struct Any<T>(PhantomData<T>);

impl<'de, T: Tolerant<'de>> Visitor<'de> for Any<T> {
    type Value = T;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("JSON")
    }
    fn visit_bool<E: Error>(self, _: bool) -> Result<T, E> {
        Ok(T::odd())
    }
    fn visit_unit<E: Error>(self) -> Result<T, E> {
        Ok(T::odd())
    }
    fn visit_u64<E: Error>(self, value: u64) -> Result<T, E> {
        Ok(T::number(value as f64))
    }
    fn visit_i64<E: Error>(self, value: i64) -> Result<T, E> {
        Ok(T::number(value as f64))
    }
    fn visit_f64<E: Error>(self, value: f64) -> Result<T, E> {
        Ok(T::number(value))
    }
    fn visit_str<E: Error>(self, text: &str) -> Result<T, E> {
        Ok(T::text(text))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<T, A::Error> {
        T::list(list)
    }
    fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<T, A::Error> {
        T::table(table)
    }
}

/// A text; a number is taken as its digits.
#[derive(Clone, Debug, Default)]
pub struct Text(pub Option<String>);

impl Tolerant<'_> for Text {
    fn odd() -> Self {
        Self(None)
    }
    fn number(value: f64) -> Self {
        Self(Some(value.to_string()))
    }
    fn text(text: &str) -> Self {
        Self(Some(text.into()))
    }
}

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}

impl Text {
    /// The text; empty where there is none.
    pub fn or_empty(&self) -> &str {
        self.0.as_deref().unwrap_or_default()
    }
}

/// A number; `NaN` where there is none.
#[derive(Clone, Copy, Debug)]
pub struct Number(pub f64);

impl Tolerant<'_> for Number {
    fn odd() -> Self {
        Self(f64::NAN)
    }
    fn number(value: f64) -> Self {
        Self(value)
    }
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}

/// A point of three numbers; `NaN` where it has others.
#[derive(Clone, Copy, Debug)]
pub struct Point(pub [f64; 3]);

impl<'de> Tolerant<'de> for Point {
    fn odd() -> Self {
        Self([f64::NAN; 3])
    }
    fn list<A: SeqAccess<'de>>(mut list: A) -> Result<Self, A::Error> {
        let mut found = [f64::NAN; 3];
        let mut count = 0;
        while let Some(Number(value)) = list.next_element()? {
            if let Some(slot) = found.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
        Ok(if count == 3 { Self(found) } else { Self::odd() })
    }
}

impl<'de> Deserialize<'de> for Point {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}

/// A list; empty where there is none.
#[derive(Clone, Debug)]
pub struct List<T>(pub Vec<T>);

impl<T> Default for List<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<'de, T: Deserialize<'de>> Tolerant<'de> for List<T> {
    fn odd() -> Self {
        Self::default()
    }
    fn list<A: SeqAccess<'de>>(mut list: A) -> Result<Self, A::Error> {
        let mut found = Vec::new();
        while let Some(item) = list.next_element()? {
            found.push(item);
        }
        Ok(Self(found))
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}

/// A table by names; empty where there is none.
#[derive(Clone, Debug)]
pub struct Table<T>(pub BTreeMap<String, T>);

impl<T> Default for Table<T> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<'de, T: Deserialize<'de>> Tolerant<'de> for Table<T> {
    fn odd() -> Self {
        Self::default()
    }
    fn table<A: MapAccess<'de>>(mut table: A) -> Result<Self, A::Error> {
        let mut found = BTreeMap::new();
        while let Some((name, value)) = table.next_entry()? {
            found.insert(name, value);
        }
        Ok(Self(found))
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Table<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}

/// An object of known members; none where something else stands.
#[derive(Clone, Debug)]
pub struct Maybe<T>(pub Option<T>);

impl<T> Default for Maybe<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<'de, T: Deserialize<'de>> Tolerant<'de> for Maybe<T> {
    fn odd() -> Self {
        Self(None)
    }
    fn table<A: MapAccess<'de>>(table: A) -> Result<Self, A::Error> {
        T::deserialize(MapAccessDeserializer::new(table)).map(|found| Self(Some(found)))
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Maybe<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}

/// Nested lists of numbers; what is none, as `null`, is a number that is missing.
#[derive(Clone, Debug, PartialEq)]
pub enum Nest {
    /// A number, or none.
    Number(Option<usize>),
    /// A list.
    List(Vec<Nest>),
}

impl Default for Nest {
    fn default() -> Self {
        Self::List(Vec::new())
    }
}

impl Nest {
    /// The list; empty for a number.
    pub fn items(&self) -> &[Nest] {
        match self {
            Self::List(items) => items,
            Self::Number(_) => &[],
        }
    }

    /// The number; none for a list.
    pub fn index(&self) -> Option<usize> {
        match self {
            Self::Number(number) => *number,
            Self::List(_) => None,
        }
    }

    /// Hands all numbers in it on.
    pub fn each(&self, to: &mut impl FnMut(usize)) {
        match self {
            Self::Number(Some(number)) => to(*number),
            Self::Number(None) => {}
            Self::List(items) => items.iter().for_each(|item| item.each(to)),
        }
    }
}

impl<'de> Tolerant<'de> for Nest {
    fn odd() -> Self {
        Self::Number(None)
    }
    fn number(value: f64) -> Self {
        let whole = value >= 0.0 && value.fract() == 0.0 && value < f64::from(u32::MAX);
        Self::Number(whole.then_some(value as usize))
    }
    fn list<A: SeqAccess<'de>>(mut list: A) -> Result<Self, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = list.next_element()? {
            items.push(item);
        }
        Ok(Self::List(items))
    }
}

impl<'de> Deserialize<'de> for Nest {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Any(PhantomData))
    }
}
