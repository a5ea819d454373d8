//! Material libraries of Wavefront OBJ (MTL): the diffuse colour, the texture over it, and how much shows through.

use super::parse::{lines, numbers};
use boresight_common::warning::Notes;
use std::collections::BTreeMap;

/// A material, as far as it is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Diffuse colour, sRGB.
    pub color: [f32; 3],
    /// 1 where nothing shows through.
    pub alpha: f32,
    /// The texture of the diffuse colour.
    pub texture: Option<Map>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            color: [1.0; 3],
            alpha: 1.0,
            texture: None,
        }
    }
}

/// A texture: `map_Kd`.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Its file as the library names it, with plain slashes.
    pub name: String,
    /// What places in the texture are multiplied by (`-s`).
    pub scale: [f32; 2],
    /// What is then added to them (`-o`).
    pub offset: [f32; 2],
}

/// Reads a library's text into materials by name; what is left out is said to the notes.
pub fn parse(text: &str, found: &mut BTreeMap<String, Material>, notes: &mut Notes) {
    let mut name: Option<String> = None;
    for (number, line) in lines(text) {
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
        let rest = rest.trim();
        if key == "newmtl" {
            found.insert(rest.to_string(), Material::default());
            name = Some(rest.to_string());
            continue;
        }
        let Some(material) = name.as_ref().and_then(|name| found.get_mut(name)) else {
            continue;
        };
        let mut refuse = || {
            notes.leave_out(
                "colours of materials that are no numbers",
                format!("line {number} of a library"),
            )
        };
        match key.to_ascii_lowercase().as_str() {
            "kd" => match numbers(rest) {
                [Some(r), Some(g), Some(b)] => material.color = [r, g, b].map(|x| x as f32),
                // A grey may be written once.
                [Some(grey), None, None] => material.color = [grey as f32; 3],
                _ => refuse(),
            },
            "d" => match numbers(rest.trim_start_matches("-halo")) {
                [Some(alpha)] => material.alpha = alpha as f32,
                _ => refuse(),
            },
            "tr" => match numbers(rest) {
                [Some(through)] => material.alpha = 1.0 - through as f32,
                _ => refuse(),
            },
            "map_kd" => material.texture = map(rest),
            _ => {}
        }
    }
}

/// A texture with the options before its name, which may hold spaces.
fn map(mut rest: &str) -> Option<Map> {
    let (mut scale, mut offset) = ([1.0; 2], [0.0; 2]);
    while let Some((option, behind)) = rest
        .split_once(char::is_whitespace)
        .filter(|(word, _)| word.starts_with('-'))
    {
        let most = match option {
            "-o" | "-s" | "-t" => 3,
            "-mm" => 2,
            "-blendu" | "-blendv" | "-boost" | "-bm" | "-cc" | "-clamp" | "-imfchan"
            | "-texres" | "-type" => 1,
            _ => break,
        };
        rest = behind.trim_start();
        let mut values = Vec::new();
        while values.len() < most {
            let (word, behind) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            let value: Option<f32> = word.parse().ok();
            // One value may stand for three, and a name follows; flags are words.
            if value.is_none() && (most > 1 || behind.is_empty()) {
                break;
            }
            values.push(value.unwrap_or_default());
            rest = behind.trim_start();
        }
        let two = |plain: f32| [0, 1].map(|k| values.get(k).copied().unwrap_or(plain));
        match option {
            "-o" => offset = two(0.0),
            "-s" => scale = two(1.0),
            _ => {}
        }
    }
    let name = rest.trim().trim_matches('"').replace('\\', "/");
    (!name.is_empty()).then_some(Map {
        name,
        scale,
        offset,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_are_read_with_options_and_spaces() {
        let text = "\u{feff}# a library\r\nnewmtl old brick\r\nKd 0.5 0.25 \\\r\n 0\r\nTr 0.25\r\n\
                    map_Kd -clamp on -s 2 3 1 -o 0.5 0.25 tex\\old brick.png\r\nnewmtl b\nd 0.5\nKd red\nmap_Kd plain.jpg\n";
        let (mut found, mut notes) = (BTreeMap::new(), Notes::default());
        parse(text, &mut found, &mut notes);
        let brick = &found["old brick"];
        assert_eq!((brick.color, brick.alpha), ([0.5, 0.25, 0.0], 0.75));
        let want = Map {
            name: "tex/old brick.png".into(),
            scale: [2.0, 3.0],
            offset: [0.5, 0.25],
        };
        assert_eq!(brick.texture, Some(want));
        let plain = &found["b"];
        assert_eq!((plain.color, plain.alpha), ([1.0; 3], 0.5));
        assert_eq!(
            plain.texture.as_ref().map(|map| map.name.as_str()),
            Some("plain.jpg")
        );
        assert_eq!(notes.count_left_out(), 1);
    }
}
