//! The recipe of a set of annotated pictures: what is drawn, in which shares and ranges.

use super::DatasetError;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A recipe; what a file leaves out has the default's value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Recipe {
    /// What the set is for, for people.
    pub description: String,
    /// Seed of every draw: the same recipe gives the same bytes.
    pub seed: u64,
    /// Places with a time, a weather and a camera of their own.
    pub scenes: u32,
    /// Pictures a scene.
    pub stills: u32,
    /// Clips, each in a scene of its own.
    pub sequences: Sequences,
    /// Share of the scenes that are kept for validation.
    pub val_share: f64,
    /// Scenes by what stands behind the targets.
    pub backgrounds: Backgrounds,
    /// Stills by how the target flies.
    pub motions: Motions,
    /// What is annotated.
    pub targets: Targets,
    /// What is not.
    pub distractors: Distractors,
    /// Light and air.
    pub light: Light,
    /// Where cameras stand and how they see.
    pub camera: Camera,
    /// The city.
    pub city: City,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            description: String::new(),
            seed: 1,
            scenes: 334,
            stills: 24,
            sequences: Sequences::default(),
            val_share: 0.15,
            backgrounds: Backgrounds::default(),
            motions: Motions::default(),
            targets: Targets::default(),
            distractors: Distractors::default(),
            light: Light::default(),
            camera: Camera::default(),
            city: City::default(),
        }
    }
}

/// Clips.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sequences {
    /// Number of clips.
    pub count: u32,
    /// Frames a clip.
    pub frames: u32,
    /// Frames a second.
    pub rate_hz: f64,
}

impl Default for Sequences {
    fn default() -> Self {
        Self {
            count: 0,
            frames: 60,
            rate_hz: 30.0,
        }
    }
}

/// Shares of the scenes; they need not add up to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Backgrounds {
    /// Nothing but sky around the target.
    pub sky: f64,
    /// Trees and fields.
    pub forest: f64,
    /// Buildings.
    pub urban: f64,
}

impl Default for Backgrounds {
    fn default() -> Self {
        Self {
            sky: 0.45,
            forest: 0.275,
            urban: 0.275,
        }
    }
}

/// Shares of the stills; they need not add up to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Motions {
    /// Level flight: tilted by a few degrees.
    pub level: f64,
    /// Tilted hard to any side.
    pub manoeuvre: f64,
    /// Pitched up or down.
    pub climb_dive: f64,
}

impl Default for Motions {
    fn default() -> Self {
        Self {
            level: 0.5,
            manoeuvre: 0.3,
            climb_dive: 0.2,
        }
    }
}

/// The UAVs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Targets {
    /// Share of the stills without a UAV.
    pub none: f64,
    /// Share of the stills with two to four UAVs.
    pub several: f64,
    /// Commonest length of a box's long side, as a share of the picture's width.
    pub mode_width_share: f64,
    /// Spread of the length's logarithm.
    pub log_sigma: f64,
    /// Share of the targets whose length is drawn evenly over its logarithm instead.
    pub even_share: f64,
    /// Shortest and longest long side [px].
    pub size_px: [f64; 2],
    /// Nearest and farthest range [m].
    pub range_m: [f64; 2],
    /// Least visible share of a UAV's silhouette.
    pub min_visible: f64,
    /// Least contrast to the surroundings, over the noise of a pixel.
    pub min_contrast: f64,
    /// Share of first-person-view racers among the UAVs.
    pub fpv: f64,
    /// Share of quadcopters.
    pub quadcopter: f64,
    /// Share of hexacopters.
    pub hexacopter: f64,
}

impl Default for Targets {
    fn default() -> Self {
        Self {
            none: 0.15,
            several: 0.12,
            mode_width_share: 0.02,
            log_sigma: 0.5,
            even_share: 0.25,
            size_px: [3.0, 60.0],
            range_m: [4.0, 2500.0],
            min_visible: 0.6,
            min_contrast: 1.5,
            fpv: 0.25,
            quadcopter: 0.5,
            hexacopter: 0.25,
        }
    }
}

/// Birds and the like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Distractors {
    /// Share of the stills that hold some.
    pub share: f64,
    /// Shortest and longest length [px].
    pub size_px: [f64; 2],
}

impl Default for Distractors {
    fn default() -> Self {
        Self {
            share: 0.4,
            size_px: [2.0, 40.0],
        }
    }
}

/// Light and air.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Light {
    /// Share of the scenes with a sun 15 to 60 deg high.
    pub day: f64,
    /// With a sun 2 to 15 deg high.
    pub low_sun: f64,
    /// With a sun from 6 deg below to 2 deg above the horizon.
    pub dusk: f64,
    /// Worst and best visibility [m].
    pub visibility_m: [f64; 2],
}

impl Default for Light {
    fn default() -> Self {
        Self {
            day: 0.6,
            low_sun: 0.25,
            dusk: 0.15,
            visibility_m: [1_500.0, 40_000.0],
        }
    }
}

/// Cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    /// Widths and heights [px]; each scene draws one.
    pub sizes_px: Vec<[u32; 2]>,
    /// Narrowest and widest horizontal field of view, drawn evenly over its logarithm [deg].
    pub hfov_deg: [f64; 2],
    /// Narrowest field of view where the background is not the sky: what stands behind the target
    /// lies within the city [deg].
    pub ground_hfov_deg: f64,
    /// Lowest and highest camera above the ground [m].
    pub height_m: [f64; 2],
    /// Least and greatest blur of optics and air [px].
    pub blur_px: [f64; 2],
    /// Most by which the automatic exposure errs [stops].
    pub exposure_error_stops: f64,
    /// Share of the stills with a camera that moved during the exposure.
    pub motion_blur_share: f64,
    /// Longest smear [px].
    pub motion_blur_px: f64,
    /// Share of the stills with a laser's flare.
    pub flare_share: f64,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            sizes_px: vec![
                [640, 480],
                [640, 480],
                [640, 480],
                [640, 480],
                [640, 512],
                [640, 512],
                [640, 360],
                [512, 512],
            ],
            hfov_deg: [0.8, 40.0],
            ground_hfov_deg: 2.0,
            height_m: [2.0, 60.0],
            blur_px: [0.3, 1.6],
            exposure_error_stops: 1.0,
            motion_blur_share: 0.3,
            motion_blur_px: 4.0,
            flare_share: 0.05,
        }
    }
}

/// The generated surroundings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct City {
    /// Smallest and largest side [m].
    pub extent_m: [f64; 2],
}

impl Default for City {
    fn default() -> Self {
        Self {
            extent_m: [900.0, 1200.0],
        }
    }
}

impl Recipe {
    /// Reads and checks a recipe file; also gives its text.
    pub fn load(path: &Path) -> Result<(Self, String), DatasetError> {
        let text = std::fs::read_to_string(path).map_err(|source| DatasetError::Read {
            path: path.into(),
            source,
        })?;
        let recipe = Self::parse(&text, &path.display().to_string())?;
        Ok((recipe, text))
    }

    /// Reads and checks a recipe; `file` is named in errors.
    pub fn parse(text: &str, file: &str) -> Result<Self, DatasetError> {
        let recipe: Self = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start.min(text.len()));
            DatasetError::Recipe {
                file: file.into(),
                line: 1 + text.as_bytes()[..at]
                    .iter()
                    .filter(|b| **b == b'\n')
                    .count(),
                why: error.message().replace('\n', " "),
            }
        })?;
        recipe.check().map_err(|(key, why)| DatasetError::Value {
            file: file.into(),
            key,
            why,
        })?;
        Ok(recipe)
    }

    /// The key of the first bad value, and what is wrong with it.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let number = |key, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err((key, format!("{value} is outside {low} to {high}")))
            }
        };
        let range = |key, [from, to]: [f64; 2], low: f64, high: f64| {
            number(key, from, low, high)?;
            number(key, to, low, high)?;
            if from <= to {
                Ok(())
            } else {
                Err((
                    key,
                    format!("{from} is above {to}; give the smaller one first"),
                ))
            }
        };
        let shares = |key, shares: &[f64]| {
            for share in shares {
                number(key, *share, 0.0, 1.0)?;
            }
            if shares.iter().sum::<f64>() > 0.0 {
                Ok(())
            } else {
                Err((key, "all shares are 0; give one of them a value".into()))
            }
        };
        number("scenes", f64::from(self.scenes), 0.0, 100_000.0)?;
        number("stills", f64::from(self.stills), 1.0, 4_000.0)?;
        let q = &self.sequences;
        number("sequences.count", f64::from(q.count), 0.0, 10_000.0)?;
        number("sequences.frames", f64::from(q.frames), 1.0, 10_000.0)?;
        number("sequences.rate_hz", q.rate_hz, 1.0, 1_000.0)?;
        number("val_share", self.val_share, 0.0, 0.9)?;
        let b = &self.backgrounds;
        shares("backgrounds", &[b.sky, b.forest, b.urban])?;
        let m = &self.motions;
        shares("motions", &[m.level, m.manoeuvre, m.climb_dive])?;
        let t = &self.targets;
        number("targets.none", t.none, 0.0, 1.0)?;
        number("targets.several", t.several, 0.0, 1.0 - t.none)?;
        number("targets.mode_width_share", t.mode_width_share, 1e-3, 0.5)?;
        number("targets.log_sigma", t.log_sigma, 0.0, 3.0)?;
        number("targets.even_share", t.even_share, 0.0, 1.0)?;
        range("targets.size_px", t.size_px, 2.0, 400.0)?;
        range("targets.range_m", t.range_m, 2.0, 10_000.0)?;
        number("targets.min_visible", t.min_visible, 0.05, 1.0)?;
        number("targets.min_contrast", t.min_contrast, 0.0, 100.0)?;
        shares("targets", &[t.fpv, t.quadcopter, t.hexacopter])?;
        number("distractors.share", self.distractors.share, 0.0, 1.0)?;
        range("distractors.size_px", self.distractors.size_px, 1.0, 400.0)?;
        let l = &self.light;
        shares("light", &[l.day, l.low_sun, l.dusk])?;
        range("light.visibility_m", l.visibility_m, 100.0, 200_000.0)?;
        let c = &self.camera;
        if c.sizes_px.is_empty() {
            return Err(("camera.sizes_px", "is empty; give [[640, 480]]".into()));
        }
        for side in c.sizes_px.iter().flatten() {
            number("camera.sizes_px", f64::from(*side), 64.0, 4096.0)?;
        }
        range("camera.hfov_deg", c.hfov_deg, 0.1, 120.0)?;
        number(
            "camera.ground_hfov_deg",
            c.ground_hfov_deg,
            0.1,
            c.hfov_deg[1],
        )?;
        range("camera.height_m", c.height_m, 1.5, 500.0)?;
        range("camera.blur_px", c.blur_px, 0.0, 10.0)?;
        number(
            "camera.exposure_error_stops",
            c.exposure_error_stops,
            0.0,
            4.0,
        )?;
        number("camera.motion_blur_share", c.motion_blur_share, 0.0, 1.0)?;
        number("camera.motion_blur_px", c.motion_blur_px, 0.0, 32.0)?;
        number("camera.flare_share", c.flare_share, 0.0, 1.0)?;
        range("city.extent_m", self.city.extent_m, 800.0, 6_000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = r#"seed = 3
scenes = 12
stills = 5
val_share = 0.2

[backgrounds]
sky = 1.0
forest = 0.5

[camera]
sizes_px = [[640, 480], [320, 240]]
hfov_deg = [1.0, 30.0]
"#;

    fn error(text: &str) -> String {
        Recipe::parse(text, "r.toml").unwrap_err().to_string()
    }

    #[test]
    fn what_is_absent_has_its_default() {
        let recipe = Recipe::parse(GOOD, "r.toml").unwrap();
        assert_eq!((recipe.scenes, recipe.backgrounds.forest), (12, 0.5));
        assert_eq!(recipe.targets, Targets::default());
        assert_eq!(Recipe::parse("", "r.toml").unwrap(), Recipe::default());
        for shipped in ["uav", "tiny"] {
            let path = format!("{}/recipes/{shipped}.toml", env!("CARGO_MANIFEST_DIR"));
            Recipe::load(Path::new(&path)).unwrap();
        }
    }

    #[test]
    fn every_error_names_file_and_key_in_one_line() {
        for (text, wanted) in [
            (
                "scnes = 3",
                &["r.toml:1:", "unknown field `scnes`", "docs/dataset.md"][..],
            ),
            (
                "\n[camera]\nhfov = 3",
                &["r.toml:3:", "unknown field `hfov`"],
            ),
            ("[targets]\nsize_px = 12", &["r.toml:2:", "invalid type"]),
            ("seed = ", &["r.toml:1:"]),
            ("stills = 0", &["r.toml: stills: 0 is outside 1 to"]),
            ("val_share = nan", &["r.toml: val_share: NaN is outside"]),
            (
                "[targets]\nsize_px = [40, 4]",
                &["targets.size_px: 40 is above 4"],
            ),
            (
                "[targets]\nnone = 0.5\nseveral = 0.6",
                &["targets.several: 0.6"],
            ),
            (
                "[backgrounds]\nsky = 0\nforest = 0\nurban = 0",
                &["backgrounds: all shares are 0"],
            ),
            ("[camera]\nsizes_px = []", &["camera.sizes_px: is empty"]),
            (
                "[camera]\nsizes_px = [[640, 0]]",
                &["camera.sizes_px: 0 is outside"],
            ),
            (
                "[city]\nextent_m = [100, 900]",
                &["city.extent_m: 100 is outside"],
            ),
        ] {
            let message = error(text);
            assert!(!message.contains('\n'), "{message}");
            for part in wanted {
                assert!(message.contains(part), "{part:?} in {message}");
            }
        }
        let message = Recipe::load(Path::new("nowhere.toml"))
            .unwrap_err()
            .to_string();
        assert!(message.contains("recipe nowhere.toml"), "{message}");
    }

    proptest! {
        #[test]
        fn mutated_recipes_are_taken_or_refused_in_one_line(
            at in 0..GOOD.len(),
            cut in 0..20usize,
            insert in "([\\[\\]{}=.,'\"\n #-]|[a-z_]{1,9}|[0-9]{1,25}|nan|inf|\\PC){0,4}",
        ) {
            let end = (at + cut).min(GOOD.len());
            let text = format!("{}{insert}{}", &GOOD[..at], &GOOD[end..]);
            if let Err(error) = Recipe::parse(&text, "r.toml") {
                let message = error.to_string();
                prop_assert!(message.starts_with("r.toml") && !message.contains('\n'), "{message}");
            }
        }

        #[test]
        fn a_recipe_survives_being_written(
            seed in 0..u64::MAX / 2,
            scenes in 0..1000u32,
            stills in 1..100u32,
            share in 0.0..0.9f64,
            low in 0.5..5.0f64,
        ) {
            let mut recipe = Recipe { seed, scenes, stills, val_share: share, ..Recipe::default() };
            recipe.camera.hfov_deg[0] = low;
            recipe.motions.level = share;
            let text = toml::to_string(&recipe).map_err(|e| TestCaseError::fail(e.to_string()))?;
            prop_assert_eq!(Recipe::parse(&text, "r.toml").ok(), Some(recipe));
        }
    }
}
