//! The statements of a Wavefront OBJ file, with places in f64.

use boresight_common::warning::Notes;
use glam::DVec3;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// In place of an index that a corner does not have.
pub const NONE: u32 = u32::MAX;

/// What a file holds.
#[derive(Debug, Default)]
pub struct Wavefront {
    /// Places of vertices; NaN where they are no numbers.
    pub places: Vec<DVec3>,
    /// Colours of vertices as the file has them; as long as `places`, or empty.
    pub colors: Vec<Option<[f32; 3]>>,
    /// Places in the texture, v upwards.
    pub uvs: Vec<[f32; 2]>,
    /// Normals.
    pub normals: Vec<[f32; 3]>,
    /// Vertex, place in the texture and normal of each corner of each face.
    pub corners: Vec<[u32; 3]>,
    /// Each face: its first corner, the number of its material in `materials` or `NONE`, and its line.
    pub faces: Vec<[u32; 3]>,
    /// Names of materials, in the order of use.
    pub materials: Vec<String>,
    /// Their numbers by their names.
    numbers: BTreeMap<String, u32>,
    /// What stands behind `mtllib`.
    pub libraries: Vec<String>,
}

/// Lines with their numbers, joined where a backslash ends one.
pub fn lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut all = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (number, line) = all.next()?;
        let mut line = Cow::Borrowed(line.trim());
        while let Some(head) = line.strip_suffix('\\') {
            let mut joined = head.to_string();
            if let Some((_, next)) = all.next() {
                joined.push(' ');
                joined.push_str(next.trim());
            }
            line = Cow::Owned(joined);
        }
        Some((number + 1, line))
    })
}

impl Wavefront {
    /// Reads a file's text; what is left out is said to the notes.
    pub fn parse(text: &str, notes: &mut Notes) -> Self {
        let mut found = Self::default();
        let mut material = NONE;
        // Lines that end with CR alone, as old programs wrote them.
        let text = match text.contains('\r') && !text.contains('\n') {
            true => Cow::Owned(text.replace('\r', "\n")),
            false => Cow::Borrowed(text),
        };
        for (number, line) in lines(&text) {
            let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
            let rest = rest.trim();
            let place = || format!("line {number}");
            match key.to_ascii_lowercase().as_str() {
                "v" => found.vertex(rest, number, notes),
                "vt" => {
                    let [u, v] = numbers(rest);
                    found
                        .uvs
                        .push([u.unwrap_or(0.0) as f32, v.unwrap_or(0.0) as f32]);
                }
                "vn" => {
                    let normal: [Option<f64>; 3] = numbers(rest);
                    found.normals.push(normal.map(|x| x.unwrap_or(0.0) as f32));
                }
                "f" | "fo" => found.face(rest, material, number, notes),
                "usemtl" => material = found.material(rest),
                "mtllib" => found.libraries.push(rest.to_string()),
                "l" | "p" => notes.leave_out("lines and points", place()),
                "curv" | "curv2" | "surf" | "bzp" | "bsp" | "cdc" | "cdp" => {
                    notes.leave_out("free-form curves and surfaces", place());
                }
                "call" | "csh" => notes.leave_out("calls of other files and programs", place()),
                // Names, smoothing, display, and what belongs to free forms.
                "" | "o" | "g" | "s" | "mg" | "vp" | "cstype" | "deg" | "bmat" | "step"
                | "parm" | "trim" | "hole" | "scrv" | "sp" | "end" | "con" | "res" | "ctech"
                | "stech" | "bevel" | "c_interp" | "d_interp" | "lod" | "shadow_obj"
                | "trace_obj" | "maplib" | "usemap" => {}
                key if key.starts_with('#') => {}
                key => {
                    let key: String = key.chars().take(20).collect();
                    notes.leave_out(
                        "statements that are not known",
                        format!("line {number}, {key:?}"),
                    );
                }
            }
        }
        found.check(notes);
        found
    }

    /// `v x y z`, with a weight or a colour behind it.
    fn vertex(&mut self, rest: &str, number: usize, notes: &mut Notes) {
        let found: [Option<f64>; 8] = numbers(rest);
        let mut place = DVec3::NAN;
        match found {
            [Some(x), Some(y), Some(z), ..] if x.is_finite() && y.is_finite() && z.is_finite() => {
                place = DVec3::new(x, y, z);
            }
            _ => notes.leave_out("vertices that are no numbers", format!("line {number}")),
        }
        if let [_, _, _, Some(weight), None, ..] = found
            && weight != 1.0
        {
            notes.leave_out("weights of vertices", format!("line {number}"));
        }
        let color = match found {
            [_, _, _, Some(r), Some(g), Some(b), ..] => Some([r, g, b].map(|x| x as f32)),
            _ => None,
        };
        if color.is_some() && self.colors.is_empty() {
            self.colors = vec![None; self.places.len()];
        }
        if color.is_some() || !self.colors.is_empty() {
            self.colors.push(color);
        }
        self.places.push(place);
    }

    /// `f v/vt/vn …`; negative numbers count back from the last one before the line.
    fn face(&mut self, rest: &str, material: u32, number: usize, notes: &mut Notes) {
        let counts = [self.places.len(), self.uvs.len(), self.normals.len()];
        let start = self.corners.len();
        let words = rest.split_ascii_whitespace();
        for word in words.take_while(|word| !word.starts_with('#')) {
            let mut parts = word.split('/');
            let mut corner = [NONE; 3];
            for (index, count) in corner.iter_mut().zip(counts) {
                let text = parts.next().filter(|text| !text.is_empty());
                *index = text.and_then(|text| counted(text, count)).unwrap_or(NONE);
            }
            self.corners.push(corner);
        }
        if self.corners.len() - start >= 3 {
            self.faces.push([start as u32, material, number as u32]);
        } else {
            self.corners.truncate(start);
            notes.leave_out(
                "faces of fewer than three corners",
                format!("line {number}"),
            );
        }
    }

    /// Leaves out faces whose vertices are not there, now that all are read: they may stand behind the faces.
    fn check(&mut self, notes: &mut Notes) {
        let corners = std::mem::take(&mut self.corners);
        let faces = std::mem::take(&mut self.faces);
        for (k, [start, material, line]) in faces.iter().enumerate() {
            let end = faces
                .get(k + 1)
                .map_or(corners.len(), |next| next[0] as usize);
            let face = &corners[*start as usize..end];
            let there = |corner: &[u32; 3]| {
                (self.places.get(corner[0] as usize)).is_some_and(|place| place.is_finite())
            };
            if !face.iter().all(there) {
                let kind = "faces with a vertex that is not there or no number";
                notes.leave_out(kind, format!("line {line}"));
                continue;
            }
            let start = self.corners.len() as u32;
            self.faces.push([start, *material, *line]);
            let known = |index: u32, count: usize| {
                if (index as usize) < count {
                    index
                } else {
                    NONE
                }
            };
            let (uvs, normals) = (self.uvs.len(), self.normals.len());
            let each = face
                .iter()
                .map(|[v, vt, vn]| [*v, known(*vt, uvs), known(*vn, normals)]);
            self.corners.extend(each);
        }
    }

    /// The number of a material.
    fn material(&mut self, name: &str) -> u32 {
        if name.is_empty() {
            return NONE;
        }
        if let Some(known) = self.numbers.get(name) {
            return *known;
        }
        let number = self.materials.len() as u32;
        self.materials.push(name.to_string());
        self.numbers.insert(name.to_string(), number);
        number
    }

    /// Corners and material of each face.
    pub fn faces(&self) -> impl Iterator<Item = (&[[u32; 3]], u32)> {
        self.faces
            .iter()
            .enumerate()
            .map(|(k, [start, material, _])| {
                let end = self
                    .faces
                    .get(k + 1)
                    .map_or(self.corners.len(), |next| next[0] as usize);
                (&self.corners[*start as usize..end], *material)
            })
    }
}

/// The index that a number from 1 or, counted back, from -1 means.
fn counted(text: &str, count: usize) -> Option<u32> {
    let number: i64 = text.parse().ok()?;
    let index = match number {
        1.. => number - 1,
        0 => return None,
        _ => number.checked_add(count as i64)?,
    };
    u32::try_from(index).ok().filter(|index| *index != NONE)
}

/// The first numbers of a line.
pub fn numbers<const N: usize>(rest: &str) -> [Option<f64>; N] {
    let mut found = [None; N];
    let words = rest
        .split_ascii_whitespace()
        .take_while(|word| !word.starts_with('#'));
    for (slot, word) in found.iter_mut().zip(words) {
        *slot = word.parse().ok();
    }
    found
}
