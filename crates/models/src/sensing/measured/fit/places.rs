//! What is taken for something where nothing flies.

use super::super::FalseRow;
use super::super::scenery::Places;
use super::data::Data;
use crate::maths::quantile::quantile;
use crate::optics::tier::Tier;
use std::collections::BTreeMap;

/// Two boxes so close together are on the same place [px].
const SAME_PX: f64 = 4.0;
/// Share of the frames in which a place is boxed, at least and at most: so few boxes do not tell.
const DUTY: [f64; 2] = [0.02, 0.95];
/// So many boxes of each class are taken as known beside the data.
const NAMES_KNOWN: f64 = 0.1;

/// The places of the cameras of a tier.
pub(super) fn places(data: &Data, tier: Tier, classes: &[String]) -> Places {
    let rows: Vec<(usize, &FalseRow)> = data
        .false_boxes
        .iter()
        .filter(|(_, row)| row.tier == tier)
        .copied()
        .collect();
    let (mut sky_mpx, mut solid_mpx) = (0.0, 0.0);
    for (_, frame) in data.frames.iter().filter(|(_, frame)| frame.tier == tier) {
        sky_mpx += frame.area_mpx * frame.sky;
        solid_mpx += frame.area_mpx * (1.0 - frame.sky);
    }
    let duty = duty(data, tier, &rows);
    let count = |in_sky: bool| rows.iter().filter(|(_, row)| row.in_sky == in_sky).count() as f64;
    let quantiles = |value: fn(&FalseRow) -> f64, default: f64| {
        let mut ascending: Vec<f64> = rows.iter().map(|(_, row)| value(row)).collect();
        ascending.sort_by(f64::total_cmp);
        std::array::from_fn(|step| quantile(&ascending, step as f64 / 10.0).unwrap_or(default))
    };
    let named = |class: &String| {
        rows.iter().filter(|(_, row)| row.name == *class).count() as f64 + NAMES_KNOWN
    };
    Places {
        sky_per_mpx: count(true) / f64::max(sky_mpx, 1.0) / duty,
        solid_per_mpx: count(false) / f64::max(solid_mpx, 1.0) / duty,
        duty,
        scores: quantiles(|row| row.score, 0.3),
        sides_px: quantiles(|row| row.box_px[0].max(row.box_px[1]), 6.0),
        named: classes.iter().map(named).collect(),
    }
}

/// How often a place that was boxed is boxed in the camera's next frame, too.
fn duty(data: &Data, tier: Tier, rows: &[(usize, &FalseRow)]) -> f64 {
    // By run and frame: the bits of times that are not below 0 have the order of the times.
    let mut by_frame: BTreeMap<(usize, u64), Vec<&FalseRow>> = BTreeMap::new();
    for (run, frame) in data.frames.iter().filter(|(_, frame)| frame.tier == tier) {
        by_frame.entry((*run, frame.t_s.to_bits())).or_default();
    }
    for (run, row) in rows {
        by_frame
            .entry((*run, row.t_s.to_bits()))
            .or_default()
            .push(row);
    }
    let frames: Vec<_> = by_frame.iter().collect();
    let (mut again, mut tries) = (0.0, 0.0);
    for pair in frames.windows(2).filter(|pair| pair[0].0.0 == pair[1].0.0) {
        for row in pair[0].1 {
            let same = |later: &&FalseRow| {
                let apart_rad =
                    [0, 1].map(|axis| (later.az_el_rad[axis] - row.az_el_rad[axis]).abs());
                apart_rad[0].max(apart_rad[1]) < SAME_PX * row.ifov_rad
            };
            tries += 1.0;
            again += f64::from(u8::from(pair[1].1.iter().any(same)));
        }
    }
    f64::clamp((again + 0.5) / (tries + 1.0), DUTY[0], DUTY[1])
}
