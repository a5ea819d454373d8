//! The header and the rows of a PLY file: ASCII, little or big endian.

/// Kind of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "long" | "int64" => Self::I64,
            "ulong" | "uint64" => Self::U64,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Its size [byte].
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Whether it has no whole numbers alone.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The number that bytes in little-endian order are.
    fn number(self, bytes: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => (a as i8).into(),
            Self::U8 => a.into(),
            Self::I16 => i16::from_le_bytes([a, b]).into(),
            Self::U16 => u16::from_le_bytes([a, b]).into(),
            Self::I32 => i32::from_le_bytes([a, b, c, d]).into(),
            Self::U32 => u32::from_le_bytes([a, b, c, d]).into(),
            Self::I64 => i64::from_le_bytes(bytes) as f64,
            Self::U64 => u64::from_le_bytes(bytes) as f64,
            Self::F32 => f32::from_le_bytes([a, b, c, d]).into(),
            Self::F64 => f64::from_le_bytes(bytes),
        }
    }
}

/// A property of an element: a number, or a list of them behind a count.
#[derive(Clone, Debug)]
pub struct Property {
    /// Its name.
    pub name: String,
    /// The kind of its numbers.
    pub kind: Kind,
    /// The kind of a list's count.
    list: Option<Kind>,
}

/// An element: what the file has rows of.
#[derive(Clone, Debug)]
pub struct Element {
    /// Its name.
    pub name: String,
    /// Number of its rows.
    pub count: usize,
    /// Its properties, in their order.
    pub properties: Vec<Property>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// What the head of a file says.
#[derive(Clone, Debug)]
pub struct Header {
    encoding: Encoding,
    /// What stands behind `comment`.
    pub comments: Vec<String>,
    /// The elements, in the order of their rows.
    pub elements: Vec<Element>,
}

impl Header {
    /// Whether its rows are text.
    pub fn is_text(&self) -> bool {
        matches!(self.encoding, Encoding::Ascii)
    }
}

/// Reads the header of a file and finds where its rows begin.
pub fn header(bytes: &[u8]) -> Result<(Header, Rows<'_>), String> {
    let mut rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut lines = 0;
    let mut next = || {
        let end = rest.iter().position(|c| matches!(c, b'\n' | b'\r'))?;
        let line = String::from_utf8_lossy(&rest[..end]).trim().to_string();
        let both = rest[end..].starts_with(b"\r\n");
        rest = &rest[end + if both { 2 } else { 1 }..];
        lines += 1;
        Some(line)
    };
    if next().as_deref() != Some("ply") {
        return Err("it does not begin with the line 'ply'".into());
    }
    let mut found = Header {
        encoding: Encoding::Ascii,
        comments: Vec::new(),
        elements: Vec::new(),
    };
    let mut formats = 0;
    loop {
        let line = next().ok_or("its header has no end")?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let wrong = || format!("its header says '{line}'");
        match words[..] {
            [] | ["obj_info", ..] => {}
            ["end_header", ..] => break,
            ["comment", ..] => found
                .comments
                .push(line["comment".len()..].trim().to_string()),
            ["format", name, ..] => {
                formats += 1;
                found.encoding = match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => return Err(wrong()),
                };
            }
            ["element", name, count, ..] => found.elements.push(Element {
                name: name.into(),
                count: count.parse().map_err(|_| wrong())?,
                properties: Vec::new(),
            }),
            ["property", ref about @ ..] => {
                let property = property(about).ok_or_else(wrong)?;
                let element = found.elements.last_mut().ok_or_else(wrong)?;
                element.properties.push(property);
            }
            _ => return Err(wrong()),
        }
    }
    if formats != 1 {
        return Err(format!("its header has {formats} lines 'format'"));
    }
    let rows = Rows {
        bytes: rest,
        at: 0,
        encoding: found.encoding,
    };
    Ok((found, rows))
}

/// What stands behind `property`.
fn property(about: &[&str]) -> Option<Property> {
    let (list, [kind, name]) = match *about {
        ["list", count, kind, name] => (Some(Kind::of(count)?), [kind, name]),
        [kind, name] => (None, [kind, name]),
        _ => return None,
    };
    Some(Property {
        name: name.into(),
        kind: Kind::of(kind)?,
        list,
    })
}

/// The rows of a file, from the first on.
#[derive(Debug)]
pub struct Rows<'b> {
    bytes: &'b [u8],
    at: usize,
    encoding: Encoding,
}

/// The numbers of a row: those of each property in turn.
#[derive(Debug, Default)]
pub struct Row {
    numbers: Vec<f64>,
    ends: Vec<usize>,
}

impl Row {
    /// The numbers of a property: one, or those of a list.
    pub fn get(&self, property: usize) -> &[f64] {
        let end = |k: usize| self.ends.get(k).copied().unwrap_or(self.numbers.len());
        let start = if property == 0 { 0 } else { end(property - 1) };
        &self.numbers[start..end(property)]
    }
}

impl Rows<'_> {
    /// Reads the rows of the next element, one after the other.
    pub fn read(&mut self, element: &Element, mut visit: impl FnMut(&Row)) -> Result<(), String> {
        // Every row has at least a byte.
        if element.count > self.bytes.len() {
            let (count, name) = (element.count, &element.name);
            return Err(format!("{count} of '{name}' in {} bytes", self.bytes.len()));
        }
        let mut row = Row::default();
        for k in 0..element.count {
            row.numbers.clear();
            row.ends.clear();
            self.row(element, &mut row).ok_or_else(|| {
                format!(
                    "it ends in row {k} of the {} of '{}'",
                    element.count, element.name
                )
            })?;
            visit(&row);
        }
        Ok(())
    }

    fn row(&mut self, element: &Element, row: &mut Row) -> Option<()> {
        for property in &element.properties {
            let count = match property.list {
                None => 1,
                Some(kind) => {
                    let count = self.number(kind)?;
                    // A list has at most as many numbers as there are bytes.
                    (0.0..=(self.bytes.len() - self.at) as f64)
                        .contains(&count)
                        .then_some(count as usize)?
                }
            };
            for _ in 0..count {
                let number = self.number(property.kind)?;
                row.numbers.push(number);
            }
            row.ends.push(row.numbers.len());
        }
        if self.encoding == Encoding::Ascii {
            // What a line has beside the properties is nobody's.
            let rest = &self.bytes[self.at..];
            self.at += rest
                .iter()
                .position(|c| matches!(c, b'\n' | b'\r'))
                .unwrap_or(rest.len());
        }
        Some(())
    }

    fn number(&mut self, kind: Kind) -> Option<f64> {
        if self.encoding == Encoding::Ascii {
            let rest = &self.bytes[self.at..];
            let start = rest.iter().position(|c| !c.is_ascii_whitespace())?;
            let rest = &rest[start..];
            let length = rest
                .iter()
                .position(u8::is_ascii_whitespace)
                .unwrap_or(rest.len());
            self.at += start + length;
            let word = str::from_utf8(&rest[..length]).ok();
            return Some(word.and_then(|word| word.parse().ok()).unwrap_or(f64::NAN));
        }
        let size = kind.size();
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(self.bytes.get(self.at..self.at + size)?);
        if self.encoding == Encoding::Big {
            bytes[..size].reverse();
        }
        self.at += size;
        Some(kind.number(bytes))
    }
}
