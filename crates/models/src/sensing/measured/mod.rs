//! A detector and a recogniser as they were measured: what they would have said of a thing, drawn from a model that was
//! fitted to what they did say in engagements on rendered pixels.
//!
//! Whether a thing is found, and how surely, comes of one number: noise that is the same again a moment later ([`Noise`]).
//! A thing is found while the noise is above what leaves the chance of detection, a probit of how the thing appears
//! ([`Appearance`]); the higher it is then, the higher the score, whose logit is normal about a mean that is linear in the
//! same terms, but not below the detector's floor. Such two-part models are due to J. G. Cragg, *Econometrica* 39 (1971) 829.
//!
//! Nothing is remembered: every draw is a function of (seed, thing, time).

mod fit;
mod noise;
mod scenery;
mod table;

pub use fit::{Fitted, Run, fit, foretold};
pub use noise::{Draws, Noise, Of};
pub use scenery::{FalseBox, Patch, Scenery};
pub use table::{Boxes, Kind, Measured, Names, Scores};

use crate::optics::tier::Tier;
use serde::{Deserialize, Serialize};

/// How a thing appears to a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Appearance {
    /// What the camera is for.
    pub tier: Tier,
    /// Longer side of its box in the picture that the detector is shown [px].
    pub size_px: f64,
    /// Whether the sky is behind it.
    pub in_sky: bool,
    /// Transmittance of the air before it, which its contrast is multiplied by, 0 to 1.
    pub transmittance: f64,
    /// Gain of the exposure, 1 or more: noise.
    pub gain: f64,
    /// How far it moves in the picture while that is exposed [px].
    pub smear_px: f64,
}

/// Sizes [px] between whose logarithms the effect of size is straight.
const KNOTS_PX: [f64; 6] = [2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

/// Terms of [`Appearance::terms`].
pub const TERMS: usize = KNOTS_PX.len() + 7;

impl Appearance {
    /// What probit and logit are linear in: six hats over the log of the size, and of what is not before the sky, of
    /// that and the log of its size, of contrast, noise, smear, and of the search and the precise camera.
    pub fn terms(&self) -> [f64; TERMS] {
        let mut terms = [0.0; TERMS];
        let (low, share) = between(self.size_px);
        terms[low] = 1.0 - share;
        terms[low + 1] = share;
        let solid = f64::from(u8::from(!self.in_sky));
        let others = [
            solid,
            solid * (self.size_px.max(1.0) / 8.0).ln(),
            self.transmittance.max(0.02).ln(),
            self.gain.max(1.0).ln(),
            (1.0 + self.smear_px).ln(),
            f64::from(u8::from(self.tier == Tier::Search)),
            f64::from(u8::from(self.tier == Tier::Precise)),
        ];
        terms[KNOTS_PX.len()..].copy_from_slice(&others);
        terms
    }
}

/// The knot at or below a size, but not the last, and how far it is from there to the next, 0 to 1.
fn between(size_px: f64) -> (usize, f64) {
    let size_px = size_px.clamp(KNOTS_PX[0], KNOTS_PX[KNOTS_PX.len() - 1]);
    let low = (1..KNOTS_PX.len() - 1).take_while(|knot| KNOTS_PX[*knot] <= size_px);
    let low = low.last().unwrap_or(0);
    let share = (size_px / KNOTS_PX[low]).ln() / (KNOTS_PX[low + 1] / KNOTS_PX[low]).ln();
    (low, share)
}

/// The knot next to a size.
fn nearest(size_px: f64) -> usize {
    let (low, share) = between(size_px);
    low + usize::from(share > 0.5)
}

/// The value at a size of a figure that is given at the knots.
fn at_size(figures: &[f64; KNOTS_PX.len()], size_px: f64) -> f64 {
    let (low, share) = between(size_px);
    figures[low] + share * (figures[low + 1] - figures[low])
}

/// What a detector or recogniser said of a thing in a frame: the data of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "row", rename_all = "snake_case")]
pub enum Row {
    /// A thing that was in the pixels in which the detector looked.
    Look(LookRow),
    /// A box on nothing that flies.
    False(FalseRow),
    /// What was looked at in a frame.
    Frame(FrameRow),
    /// What the recogniser said of a track.
    Named(NamedRow),
}

/// A thing in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LookRow {
    /// Time of the exposure [s].
    pub t_s: f64,
    /// Number of the thing in its run.
    pub thing: usize,
    /// What it is, as [`crate::tracking::recognition::TrackClass`] names it.
    pub kind: String,
    /// How it appeared.
    pub appearance: Appearance,
    /// Width and height of its true box [px].
    pub box_px: [f64; 2],
    /// The detector's surest box on it.
    pub found: Option<FoundRow>,
    /// Whether it was found by its motion alone.
    pub moving: bool,
}

/// A box on a thing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundRow {
    /// The detector's score.
    pub score: f64,
    /// The class that it names.
    pub name: String,
    /// Its middle less the true one [px].
    pub off_px: [f64; 2],
    /// Its width and height [px].
    pub box_px: [f64; 2],
}

/// A box on nothing that flies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FalseRow {
    /// Time of the exposure [s].
    pub t_s: f64,
    /// The camera's tier.
    pub tier: Tier,
    /// Azimuth and elevation [rad], and what a pixel sees of them [rad].
    pub az_el_rad: [f64; 2],
    pub ifov_rad: f64,
    /// The detector's score.
    pub score: f64,
    /// The class that it names.
    pub name: String,
    /// Its width and height [px].
    pub box_px: [f64; 2],
    /// Whether the sky is there.
    pub in_sky: bool,
}

/// What was looked at in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRow {
    /// Time of the exposure [s].
    pub t_s: f64,
    /// The camera's tier.
    pub tier: Tier,
    /// Area [Mpx], and the share of it that shows the sky.
    pub area_mpx: f64,
    pub sky: f64,
    /// Scores from which on boxes go on with a track, and start one.
    pub floor: f64,
    pub start: f64,
}

/// What the recogniser said of a track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedRow {
    /// When [s].
    pub t_s: f64,
    /// The track, and the number of the thing that it is of; none of scenery.
    pub track: u32,
    pub thing: Option<usize>,
    /// What the thing is.
    pub kind: String,
    /// Size of the track in its best view [px].
    pub size_px: f64,
    /// Probabilities by [`crate::tracking::recognition::TrackClass::ALL`].
    pub probabilities: [f64; 6],
}

#[cfg(test)]
mod tests;
