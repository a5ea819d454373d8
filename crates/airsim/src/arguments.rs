//! The arguments of a call, read one after the other.

use glam::DVec3;
use rmpv::Value;

/// The arguments of a call that are still to be read. What is wrong with one is said in a line that names it.
#[derive(Debug)]
pub struct Arguments {
    method: String,
    values: std::vec::IntoIter<Value>,
    /// Number of the last one read.
    number: usize,
}

impl Arguments {
    /// Of a call.
    pub fn new(method: &str, values: Vec<Value>) -> Self {
        Self {
            method: method.to_owned(),
            values: values.into_iter(),
            number: 0,
        }
    }

    /// Name of the method.
    pub fn method(&self) -> &str {
        &self.method
    }

    /// A line about the call.
    pub fn wrong(&self, why: impl std::fmt::Display) -> String {
        format!("{}: {why}", self.method)
    }

    fn read<T>(
        &mut self,
        name: &str,
        wanted: &str,
        read: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<T, String> {
        self.number += 1;
        let value = self.values.next();
        let read = value.as_ref().and_then(read);
        let found = || match &value {
            None => "is missing".to_owned(),
            Some(value) => format!("is {}", shortly(value)),
        };
        read.ok_or_else(|| {
            let why = format!(
                "argument {} ({name}) {}: give {wanted}",
                self.number,
                found()
            );
            self.wrong(why)
        })
    }

    /// The next one, whatever it is; nil where there is none.
    pub fn value(&mut self) -> Value {
        self.number += 1;
        self.values.next().unwrap_or(Value::Nil)
    }

    /// A number, which may come as a whole one; it is finite.
    pub fn number(&mut self, name: &str) -> Result<f64, String> {
        self.read(name, "a number", finite)
    }

    /// A whole number from 0 on, which may come with a point.
    pub fn whole(&mut self, name: &str) -> Result<u64, String> {
        self.read(name, "a whole number from 0 on", whole)
    }

    /// True or false, which may come as 1 or 0.
    pub fn flag(&mut self, name: &str) -> Result<bool, String> {
        self.read(name, "true or false", flag)
    }

    /// A text.
    pub fn text(&mut self, name: &str) -> Result<String, String> {
        self.read(name, "a text", text)
    }

    /// A text; an empty one where there is none.
    pub fn maybe_text(&mut self, name: &str) -> Result<String, String> {
        match self.values.as_slice().first() {
            None => Ok(String::new()),
            Some(_) => self.text(name),
        }
    }

    /// A vector of AirSim's, `x_val`, `y_val`, `z_val`.
    pub fn vector(&mut self, name: &str) -> Result<DVec3, String> {
        self.read(name, "a Vector3r of three numbers", vector)
    }

    /// A list, each of which `read` reads.
    pub fn list<T>(
        &mut self,
        name: &str,
        wanted: &str,
        read: impl Fn(&Value) -> Option<T>,
    ) -> Result<Vec<T>, String> {
        self.read(name, wanted, |value| {
            value.as_array()?.iter().map(read).collect()
        })
    }
}

/// What a value is, for an error.
fn shortly(value: &Value) -> String {
    let text = value.to_string();
    match text.chars().count() > 40 {
        true => format!("{} ...", text.chars().take(40).collect::<String>()),
        false => text,
    }
}

/// A finite number.
pub fn finite(value: &Value) -> Option<f64> {
    value.as_f64().filter(|number| number.is_finite())
}

/// A whole number from 0 on.
pub fn whole(value: &Value) -> Option<u64> {
    let with_point = || {
        let number = finite(value)?;
        let is_whole = number >= 0.0 && number.fract() == 0.0 && number <= 2f64.powi(53);
        is_whole.then_some(number as u64)
    };
    value.as_u64().or_else(with_point)
}

/// True or false.
pub fn flag(value: &Value) -> Option<bool> {
    match value {
        Value::Boolean(is) => Some(*is),
        _ => match value.as_u64()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        },
    }
}

/// A text.
pub fn text(value: &Value) -> Option<String> {
    match value {
        Value::Binary(bytes) => String::from_utf8(bytes.clone()).ok(),
        _ => value.as_str().map(str::to_owned),
    }
}

/// What a map holds under a key.
pub fn of_map<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    let pairs = value.as_map()?;
    let found = pairs.iter().find(|(name, _)| match name {
        Value::Binary(bytes) => bytes == key.as_bytes(),
        _ => name.as_str() == Some(key),
    });
    found.map(|(_, value)| value)
}

/// A vector of AirSim's.
pub fn vector(value: &Value) -> Option<DVec3> {
    let axis = |key| of_map(value, key).and_then(finite);
    Some(DVec3::new(axis("x_val")?, axis("y_val")?, axis("z_val")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_as_they_like_and_errors_name_their_place() {
        let point = Value::Map(vec![
            ("x_val".into(), 1.into()),
            ("y_val".into(), Value::from(-2.5)),
            ("z_val".into(), Value::from(3u64)),
        ]);
        let values = vec![3.into(), Value::from(2.0), 1.into(), point, "a".into()];
        let mut arguments = Arguments::new("moveIt", values.clone());
        assert_eq!(arguments.number("x"), Ok(3.0));
        assert_eq!(arguments.whole("n"), Ok(2));
        assert_eq!(arguments.flag("is"), Ok(true));
        assert_eq!(arguments.vector("at"), Ok(DVec3::new(1.0, -2.5, 3.0)));
        assert_eq!(
            arguments.number("v").unwrap_err(),
            "moveIt: argument 5 (v) is \"a\": give a number"
        );
        assert_eq!(
            arguments.text("name").unwrap_err(),
            "moveIt: argument 6 (name) is missing: give a text"
        );
        assert_eq!(arguments.maybe_text("name"), Ok(String::new()));
        for wrong in [
            Value::from(f64::NAN),
            Value::from(-1),
            "x".repeat(99).into(),
        ] {
            let error = Arguments::new("m", vec![wrong]).whole("n").unwrap_err();
            assert!(
                error.starts_with("m: argument 1 (n) is ") && error.len() < 120,
                "{error}"
            );
        }
    }
}
