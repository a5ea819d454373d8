//! What a detector takes for something where nothing flies: places that come back frame after frame.

use crate::maths::rng::Stream;
use crate::optics::tier::Tier;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Side of the squares of the sky in which places are drawn [px].
const CELL_PX: f64 = 128.0;
/// Time after which the light, and with it the places, are others [s].
pub const LASTS_S: f64 = 2.0;
/// Quantiles that a distribution is kept by.
const QUANTILES: usize = 11;

/// False boxes of the cameras of each tier.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenery {
    /// Of the search, the coarse and the precise camera.
    pub search: Places,
    pub coarse: Places,
    pub precise: Places,
}

/// Places that a camera takes for something.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Places {
    /// How many there are in a million pixels of sky, and of anything else.
    pub sky_per_mpx: f64,
    pub solid_per_mpx: f64,
    /// Share of the frames in which one is boxed.
    pub duty: f64,
    /// Scores and longer sides [px] of their boxes, by their quantiles in equal steps from 0 to 1.
    pub scores: [f64; QUANTILES],
    pub sides_px: [f64; QUANTILES],
    /// Shares of the detector's classes.
    pub named: Vec<f64>,
}

/// A part of the sky in which a camera looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// The camera's tier, and what a pixel of it sees [rad].
    pub tier: Tier,
    pub ifov_rad: f64,
    /// Least and greatest azimuth, not wrapped, and elevation [rad].
    pub az_rad: [f64; 2],
    pub el_rad: [f64; 2],
}

/// A box where nothing flies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FalseBox {
    /// Its middle: azimuth and elevation [rad].
    pub az_el_rad: [f64; 2],
    /// Its longer side [px].
    pub side_px: f64,
    /// Score, and class.
    pub score: f64,
    pub label: u32,
}

impl Scenery {
    /// Those of a tier.
    pub fn of(&self, tier: Tier) -> &Places {
        match tier {
            Tier::Search => &self.search,
            Tier::Coarse => &self.coarse,
            Tier::Precise => &self.precise,
        }
    }
}

impl Places {
    /// The false boxes in a patch of the sky at a time [s], in a frame that `frame` tells from others; `in_sky` says whether
    /// the sky is in a direction of azimuth and elevation [rad].
    pub fn boxes(
        &self,
        seed: u64,
        patch: &Patch,
        t_s: f64,
        frame: u64,
        mut in_sky: impl FnMut([f64; 2]) -> bool,
    ) -> Vec<FalseBox> {
        // A whole number of squares goes round the horizon, so that south is no edge.
        let columns = (TAU / (CELL_PX * patch.ifov_rad)).ceil();
        let cell_rad = TAU / columns;
        let most = self.sky_per_mpx.max(self.solid_per_mpx);
        let mean = most * (cell_rad / patch.ifov_rad).powi(2) * 1e-6;
        let cells = |[low, high]: [f64; 2]| {
            (low / cell_rad).floor() as i64..=(high / cell_rad).floor() as i64
        };
        let holds = |[low, high]: [f64; 2], at: f64| (low..high).contains(&at);
        let mut boxes = Vec::new();
        for column in cells(patch.az_rad) {
            for row in cells(patch.el_rad) {
                let turned = column.rem_euclid(columns as i64) as u64;
                let cell =
                    turned.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (row as u64).rotate_left(32);
                let key = cell ^ ((patch.tier as u64) << 60);
                // Places do not all change at once.
                let shifted = t_s / LASTS_S + (cell >> 40) as f64 / (1_u64 << 24) as f64;
                let place = key ^ (shifted.floor() as u64).rotate_left(17);
                let mut draw = Stream::new(seed, place, "false boxes");
                let mut now = Stream::new(seed, place ^ frame.rotate_left(23), "false boxes now");
                for _ in 0..draw.poisson(mean) {
                    let at = [column, row].map(|index| (index as f64 + draw.uniform()) * cell_rad);
                    let found = FalseBox {
                        az_el_rad: at,
                        score: drawn(&self.scores, draw.uniform()),
                        side_px: drawn(&self.sides_px, draw.uniform()),
                        label: pick(self.named.iter().copied(), draw.uniform()),
                    };
                    let (kept, boxed) = (draw.uniform(), now.uniform() < self.duty);
                    let within = holds(patch.az_rad, at[0]) && holds(patch.el_rad, at[1]);
                    let here = |in_sky: bool| match in_sky {
                        true => self.sky_per_mpx,
                        false => self.solid_per_mpx,
                    };
                    if boxed && within && kept * most < here(in_sky(at)) {
                        boxes.push(found);
                    }
                }
            }
        }
        boxes
    }
}

/// The value at a share, 0 to 1, of a distribution.
fn drawn(quantiles: &[f64; QUANTILES], share: f64) -> f64 {
    let at = share * (QUANTILES - 1) as f64;
    let low = (at as usize).min(QUANTILES - 2);
    quantiles[low] + (at - low as f64) * (quantiles[low + 1] - quantiles[low])
}

/// The index at a share, 0 to 1, of the sum of some shares.
pub(super) fn pick(shares: impl Iterator<Item = f64> + Clone, share: f64) -> u32 {
    let mut left = share * shares.clone().sum::<f64>();
    let at = shares.into_iter().position(|share| {
        left -= share;
        left < 0.0
    });
    at.unwrap_or(0) as u32
}
