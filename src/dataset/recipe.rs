//! The recipe of a set of annotated pictures: what is drawn, in which shares and ranges.

use super::shares::Motion;
use crate::models::flight::class::ObjectClass;
use crate::scenario::check::{Check, FRACTION};
use crate::scenario::load::{self, Checked};
use crate::scenario::{InputError, catalogue};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// A recipe; what a file leaves out has the default's value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Recipe {
    /// What the set is for, for people.
    pub description: String,
    /// Seed of every draw: the same recipe, with the same clips, gives the same bytes.
    pub seed: u64,
    /// Places with a time, a weather and a camera of their own.
    pub scenes: u32,
    /// Pictures a scene.
    pub stills: u32,
    /// Rendered sequences, each in a scene of its own.
    pub sequences: Sequences,
    /// Share of the scenes that are kept for validation.
    pub val_share: f64,
    /// Scenes by what stands behind the targets.
    pub backgrounds: Backgrounds,
    /// Stills by how the target flies.
    pub motions: Motions,
    /// What is annotated.
    pub targets: Targets,
    /// Birds, aircraft and the like.
    pub distractors: Distractors,
    /// Light and air.
    pub light: Light,
    /// Where cameras stand and how they see.
    pub camera: CameraRanges,
    /// The generated surroundings.
    pub city: CityRanges,
    /// Pictures of real cameras beside the rendered ones.
    pub real: Real,
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
            camera: CameraRanges::default(),
            city: CityRanges::default(),
            real: Real::default(),
        }
    }
}

/// Rendered sequences.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sequences {
    /// Number of sequences.
    pub count: u32,
    /// Frames a sequence.
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

impl Sequences {
    fn check(&self, check: &mut Check) {
        check.within("count", self.count.into(), 0.0..=10_000.0);
        check.within("frames", self.frames.into(), 1.0..=10_000.0);
        check.within("rate_hz", self.rate_hz, 1.0..=1_000.0);
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

impl Backgrounds {
    fn check(&self, check: &mut Check) {
        let shares = [
            ("sky", self.sky),
            ("forest", self.forest),
            ("urban", self.urban),
        ];
        check_shares(check, &shares);
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

impl Motions {
    /// The shares of [`Motion::ALL`], in its order.
    pub fn shares(&self) -> [f64; Motion::ALL.len()] {
        [self.level, self.manoeuvre, self.climb_dive]
    }

    fn check(&self, check: &mut Check) {
        let shares = [
            ("level", self.level),
            ("manoeuvre", self.manoeuvre),
            ("climb_dive", self.climb_dive),
        ];
        check_shares(check, &shares);
    }
}

/// The UAVs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Targets {
    /// Models as a scenario names them; several of a class are drawn equally often.
    pub models: Vec<String>,
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
            models: [
                "phantom4",
                "mavic2",
                "mavic_air",
                "matrice200",
                "matrice600",
                "fpv5",
            ]
            .map(String::from)
            .to_vec(),
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

impl Targets {
    /// The classes, and their shares.
    pub fn shares(&self) -> ([ObjectClass; 3], [f64; 3]) {
        let named = [
            (ObjectClass::Fpv, self.fpv),
            (ObjectClass::Quadcopter, self.quadcopter),
            (ObjectClass::Hexacopter, self.hexacopter),
        ];
        (named.map(|(class, _)| class), named.map(|(_, share)| share))
    }

    fn check(&self, check: &mut Check) {
        for (index, model) in self.models.iter().enumerate() {
            catalogue::check_learned(check, &format!("models[{index}]"), model);
        }
        check.within("none", self.none, FRACTION);
        check.within("several", self.several, 0.0..=1.0 - self.none);
        check.within("mode_width_share", self.mode_width_share, 1e-3..=0.5);
        check.within("log_sigma", self.log_sigma, 0.0..=3.0);
        check.within("even_share", self.even_share, FRACTION);
        check.not_descending("size_px", self.size_px, 2.0..=400.0);
        check.not_descending("range_m", self.range_m, 2.0..=10_000.0);
        check.within("min_visible", self.min_visible, 0.05..=1.0);
        check.within("min_contrast", self.min_contrast, 0.0..=100.0);
        let (classes, shares) = self.shares();
        let named: Vec<_> = classes.iter().map(|c| c.name()).zip(shares).collect();
        check_shares(check, &named);
    }
}

/// Birds, aircraft and the like, which are annotated with their classes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Distractors {
    /// Share of the stills with UAVs that hold some.
    pub share: f64,
    /// Share of the stills without a UAV that hold some.
    pub alone: f64,
    /// Share of those beside a UAV of which one lies within 2 deg of it and is about as large.
    pub near: f64,
    /// Share of the birds whose species has a flock in the scene that come with it.
    pub flock: f64,
    /// Share of birds among the distractors.
    pub bird: f64,
    /// Share of aeroplanes.
    pub aeroplane: f64,
    /// Share of helicopters.
    pub helicopter: f64,
    /// Share of balloons.
    pub balloon: f64,
    /// Share of leaves and scraps.
    pub other: f64,
    /// Shortest and longest length [px].
    pub size_px: [f64; 2],
}

impl Default for Distractors {
    fn default() -> Self {
        Self {
            share: 0.4,
            alone: 0.75,
            near: 0.4,
            flock: 0.5,
            bird: 0.45,
            aeroplane: 0.2,
            helicopter: 0.2,
            balloon: 0.08,
            other: 0.07,
            size_px: [2.5, 60.0],
        }
    }
}

impl Distractors {
    /// The classes, and their shares.
    pub fn shares(&self) -> ([ObjectClass; 5], [f64; 5]) {
        let named = [
            (ObjectClass::Bird, self.bird),
            (ObjectClass::Aeroplane, self.aeroplane),
            (ObjectClass::Helicopter, self.helicopter),
            (ObjectClass::Balloon, self.balloon),
            (ObjectClass::Other, self.other),
        ];
        (named.map(|(class, _)| class), named.map(|(_, share)| share))
    }

    fn check(&self, check: &mut Check) {
        for (key, share) in [
            ("share", self.share),
            ("alone", self.alone),
            ("near", self.near),
            ("flock", self.flock),
        ] {
            check.within(key, share, FRACTION);
        }
        let (classes, shares) = self.shares();
        let named: Vec<_> = classes.iter().map(|c| c.name()).zip(shares).collect();
        check_shares(check, &named);
        check.not_descending("size_px", self.size_px, 1.0..=400.0);
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

impl Light {
    fn check(&self, check: &mut Check) {
        let shares = [
            ("day", self.day),
            ("low_sun", self.low_sun),
            ("dusk", self.dusk),
        ];
        check_shares(check, &shares);
        check.not_descending("visibility_m", self.visibility_m, 100.0..=200_000.0);
    }
}

/// Cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraRanges {
    /// Widths and heights [px]; each scene draws one.
    pub sizes_px: Vec<[u32; 2]>,
    /// Narrowest and widest horizontal field of view, drawn evenly over its logarithm [deg].
    pub hfov_deg: [f64; 2],
    /// Narrowest field of view where the background is not the sky: what stands behind the target
    /// lies within the city [deg].
    pub ground_hfov_deg: f64,
    /// Lowest and highest camera above the ground [m].
    pub height_m: [f64; 2],
    /// Share of the stills before the sky alone that look far up, as people film aircraft.
    pub from_below: f64,
    /// Least and greatest blur of optics and air [px].
    pub blur_px: [f64; 2],
    /// Most by which the automatic exposure errs [stops].
    pub exposure_error_stops: f64,
    /// Standard deviation of the white balance's error in red and in blue [stops].
    pub white_balance_error_stops: f64,
    /// Share of the cameras behind a Bayer mosaic; the others see every colour at every pixel.
    pub mosaic_share: f64,
    /// Share of the stills with a camera or UAVs that moved during the exposure.
    pub motion_blur_share: f64,
    /// Longest smear [px].
    pub motion_blur_px: f64,
    /// Share of the stills with a laser's flare.
    pub flare_share: f64,
}

impl Default for CameraRanges {
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
            from_below: 0.25,
            blur_px: [0.3, 1.6],
            exposure_error_stops: 1.0,
            white_balance_error_stops: 0.15,
            mosaic_share: 0.8,
            motion_blur_share: 0.3,
            motion_blur_px: 4.0,
            flare_share: 0.05,
        }
    }
}

impl CameraRanges {
    fn check(&self, check: &mut Check) {
        check.that(!self.sizes_px.is_empty(), "sizes_px", || {
            "is empty: give [[640, 480]]".to_owned()
        });
        for (index, size_px) in self.sizes_px.iter().enumerate() {
            for (axis, side) in size_px.iter().enumerate() {
                let key = format!("sizes_px[{index}][{axis}]");
                check.within(&key, f64::from(*side), 64.0..=4096.0);
            }
        }
        check.not_descending("hfov_deg", self.hfov_deg, 0.1..=120.0);
        let widest_deg = self.hfov_deg[1];
        check.within("ground_hfov_deg", self.ground_hfov_deg, 0.1..=widest_deg);
        check.not_descending("height_m", self.height_m, 1.5..=500.0);
        check.not_descending("blur_px", self.blur_px, 0.0..=10.0);
        let most_stops = self.exposure_error_stops;
        check.within("exposure_error_stops", most_stops, 0.0..=4.0);
        let most_stops = self.white_balance_error_stops;
        check.within("white_balance_error_stops", most_stops, 0.0..=2.0);
        check.within("mosaic_share", self.mosaic_share, FRACTION);
        check.within("from_below", self.from_below, FRACTION);
        check.within("motion_blur_share", self.motion_blur_share, FRACTION);
        check.within("motion_blur_px", self.motion_blur_px, 0.0..=32.0);
        check.within("flare_share", self.flare_share, FRACTION);
    }
}

/// The generated surroundings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CityRanges {
    /// Smallest and largest side [m].
    pub extent_m: [f64; 2],
}

impl Default for CityRanges {
    fn default() -> Self {
        Self {
            extent_m: [900.0, 1200.0],
        }
    }
}

impl CityRanges {
    fn check(&self, check: &mut Check) {
        check.not_descending("extent_m", self.extent_m, 800.0..=6_000.0);
    }
}

/// Pictures of real cameras: frames of the clips of the folder that `--real` names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Real {
    /// Pictures of all clips; each class's are shared out among its clips, of which some have fewer that differ.
    pub pictures: u32,
    /// Clips that are kept for validation, by their files' names without ending; name all of a place.
    pub val: Vec<String>,
    /// Share of the training crops that are cut from real pictures.
    pub crops: f64,
    /// Classes of the clips' labels that are no class's name.
    pub labels: BTreeMap<String, ObjectClass>,
    /// Share of pictures of UAVs.
    pub uav: f64,
    /// Share of pictures of birds.
    pub bird: f64,
    /// Share of pictures of aeroplanes.
    pub aeroplane: f64,
    /// Share of pictures of helicopters.
    pub helicopter: f64,
    /// Share of pictures of balloons.
    pub balloon: f64,
    /// Share of pictures of anything else.
    pub other: f64,
}

impl Default for Real {
    fn default() -> Self {
        let labels = ["drone", "uav"].map(|label| (label.to_owned(), ObjectClass::Quadcopter));
        Self {
            pictures: 0,
            val: Vec::new(),
            crops: 0.5,
            labels: labels.into(),
            uav: 0.4,
            bird: 0.25,
            aeroplane: 0.175,
            helicopter: 0.175,
            balloon: 0.0,
            other: 0.0,
        }
    }
}

impl Real {
    /// What a class's share is called; UAVs have one in common.
    pub fn shared(class: ObjectClass) -> &'static str {
        if class.is_uav() { "uav" } else { class.name() }
    }

    /// The share of a class's clips.
    pub fn share(&self, class: ObjectClass) -> f64 {
        match class {
            ObjectClass::Fpv | ObjectClass::Quadcopter | ObjectClass::Hexacopter => self.uav,
            ObjectClass::Bird => self.bird,
            ObjectClass::Aeroplane => self.aeroplane,
            ObjectClass::Helicopter => self.helicopter,
            ObjectClass::Balloon => self.balloon,
            ObjectClass::Other => self.other,
        }
    }

    fn check(&self, check: &mut Check) {
        check.within("pictures", self.pictures.into(), 0.0..=1_000_000.0);
        check.within("crops", self.crops, FRACTION);
        let shares = [
            ("uav", self.uav),
            ("bird", self.bird),
            ("aeroplane", self.aeroplane),
            ("helicopter", self.helicopter),
            ("balloon", self.balloon),
            ("other", self.other),
        ];
        check_shares(check, &shares);
    }
}

impl Recipe {
    /// Reads and checks a recipe file; also gives its text.
    pub fn load(path: &Path) -> Result<(Self, String), InputError> {
        let path = crate::data::found(path);
        let text = load::read(&path)?;
        let recipe = Self::parse(&text, &path.display().to_string())?;
        Ok((recipe, text))
    }

    /// Reads and checks a recipe; `file` is named in errors.
    pub fn parse(text: &str, file: &str) -> Result<Self, InputError> {
        load::parse(text, file, &[]).map(|parsed| parsed.value)
    }
}

impl Checked for Recipe {
    fn check(&self, check: &mut Check) {
        check.within("scenes", self.scenes.into(), 0.0..=100_000.0);
        check.within("stills", self.stills.into(), 1.0..=4_000.0);
        check.table("sequences", |check| self.sequences.check(check));
        check.within("val_share", self.val_share, 0.0..=0.9);
        check.table("backgrounds", |check| self.backgrounds.check(check));
        check.table("motions", |check| self.motions.check(check));
        check.table("targets", |check| self.targets.check(check));
        check.table("distractors", |check| self.distractors.check(check));
        check.table("light", |check| self.light.check(check));
        check.table("camera", |check| self.camera.check(check));
        check.table("city", |check| self.city.check(check));
        check.table("real", |check| self.real.check(check));
    }
}

/// Shares need not add up to 1, but one of them must be above 0.
fn check_shares(check: &mut Check, shares: &[(&str, f64)]) {
    for (key, share) in shares {
        check.within(key, *share, FRACTION);
    }
    let total: f64 = shares.iter().map(|(_, share)| share).sum();
    check.that(total > 0.0, "", || {
        let keys: Vec<&str> = shares.iter().map(|(key, _)| *key).collect();
        format!("{} are all 0: give one of them a share", keys.join(", "))
    });
}

#[cfg(test)]
mod tests;
