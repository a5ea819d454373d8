//! Where boxes lie, and how large they are.

use super::super::{Boxes, FoundRow, KNOTS_PX, LookRow, Noise, at_size, nearest};
use super::going_on::parts;
use super::middle::{median, rms_of_most};
use crate::optics::tier::Tier;
use std::collections::BTreeMap;

/// Least boxes on a thing from which their own spread is taken.
const LEAST_BOXES: usize = 30;
/// So many boxes, and things, with the errors of the kind that this one is like are taken as known beside the data.
const BOXES_KNOWN: f64 = 40.0;
const THINGS_KNOWN: f64 = 2.0;
/// Errors of a kind that is like no other: of the middle [px] with what a larger box adds as a share of its side, and of
/// the log of a side. Assumed; the data outweigh them.
const ASSUMED_OFF_PX: f64 = 0.3;
const ASSUMED_OFF_SHARE: f64 = 0.015;
const ASSUMED_LOG_SIDE: f64 = 0.15;

/// The boxes of a kind that is like another.
pub(super) fn boxes(looks: &[(usize, &LookRow)], like: Option<&Boxes>) -> Boxes {
    let mut side: [Vec<f64>; KNOTS_PX.len()] = Default::default();
    let found: Vec<_> = (looks.iter())
        .filter_map(|(run, look)| Some((*run, *look, look.found.as_ref()?)))
        .collect();
    let log_sides = |look: &LookRow, found: &FoundRow| {
        [0, 1].map(|axis| (found.box_px[axis].max(0.1) / look.box_px[axis].max(0.5)).ln())
    };
    for (_, look, found) in &found {
        let knot = nearest(look.appearance.size_px);
        side[knot].extend(log_sides(look, found));
    }
    // Of few boxes, the errors of the kind that this one is like.
    let known = |values: &[f64], figure: fn(&[f64]) -> f64, like: f64| {
        let weight = values.len() as f64 / (values.len() as f64 + BOXES_KNOWN);
        let own = if values.is_empty() {
            like
        } else {
            figure(values)
        };
        weight * own + (1.0 - weight) * like
    };
    let at = |knot: usize, figures: fn(&Boxes) -> &[f64; KNOTS_PX.len()], default: f64| {
        like.map_or(default, |like| figures(like)[knot])
    };
    let mut fitted = Boxes {
        off_px: [0.0; KNOTS_PX.len()],
        bias: 0.0,
        spread: 0.0,
        off: Noise::default(),
        log_side: [0.0; KNOTS_PX.len()],
        log_side_sigma: [0.0; KNOTS_PX.len()],
        side: Noise::default(),
    };
    for (knot, side) in side.iter().enumerate() {
        let mean = known(side, median, at(knot, |b| &b.log_side, 0.0));
        let about: Vec<f64> = side.iter().map(|value| value - mean).collect();
        let like = at(knot, |b| &b.log_side_sigma, ASSUMED_LOG_SIDE);
        fitted.log_side[knot] = mean;
        fitted.log_side_sigma[knot] = known(&about, rms_of_most, like);
    }
    // Errors of a thing's boxes about their own mean; both axes of a thing are series of their own.
    let mut series: BTreeMap<_, Vec<(f64, f64, f64)>> = BTreeMap::new();
    for (run, look, found) in &found {
        for axis in 0..2 {
            let key = (*run, look.thing, look.appearance.tier, axis);
            let value = (look.t_s, found.off_px[axis], look.appearance.size_px);
            series.entry(key).or_default().push(value);
        }
    }
    series.retain(|_, values| values.len() >= LEAST_BOXES);
    let mut sigmas_px: [Vec<f64>; KNOTS_PX.len()] = Default::default();
    let mut own = Vec::new();
    for values in series.values() {
        let offs: Vec<f64> = values.iter().map(|(_, off_px, _)| *off_px).collect();
        let mean = median(&offs);
        let about: Vec<f64> = offs.iter().map(|off_px| off_px - mean).collect();
        let sigma_px = rms_of_most(&about).max(0.02);
        let size_px = values.iter().map(|(.., size_px)| size_px).sum::<f64>() / values.len() as f64;
        sigmas_px[nearest(size_px)].push(sigma_px);
        own.push((size_px, mean, sigma_px));
    }
    for (knot, sigmas_px) in sigmas_px.iter().enumerate() {
        let like = at(
            knot,
            |b| &b.off_px,
            ASSUMED_OFF_PX + ASSUMED_OFF_SHARE * KNOTS_PX[knot],
        );
        let count = sigmas_px.len() as f64;
        fitted.off_px[knot] =
            (count * median(sigmas_px) + THINGS_KNOWN * like) / (count + THINGS_KNOWN);
    }
    let typical = |size_px: f64| at_size(&fitted.off_px, size_px).max(0.02);
    let biases = own
        .iter()
        .map(|(size_px, mean, _)| mean / typical(*size_px));
    let spreads = own
        .iter()
        .map(|(size_px, _, sigma_px)| (sigma_px / typical(*size_px)).ln());
    let (bias, spread) = (
        rms_of_most(&biases.collect::<Vec<_>>()),
        rms_of_most(&spreads.collect::<Vec<_>>()),
    );
    // How errors go on matters where they steer the mirror: that of the middle one of all things, since the worst would
    // count for all where they are thrown together.
    let steering = series.iter().filter(|((_, _, tier, _), values)| {
        *tier == Tier::Precise && values.len() >= 2 * LEAST_BOXES
    });
    let each: Vec<Noise> = steering
        .map(|(_, values)| {
            let errors = values.iter().map(|(t_s, off_px, _)| ((), *t_s, *off_px));
            parts(errors.collect())
        })
        .collect();
    let middle = |part: fn(&Noise) -> f64| median(&each.iter().map(part).collect::<Vec<_>>());
    let changing = [
        middle(|noise| noise.changing[0]),
        middle(|noise| noise.changing[1] + noise.lasting),
    ];
    let off = Noise {
        frame: (1.0 - changing[0] - changing[1]).max(0.0),
        changing,
        lasting: 0.0,
    };
    let sides = (found.iter()).filter(|(_, look, _)| look.appearance.tier == Tier::Precise);
    let sides = sides.map(|(run, look, found)| {
        let [log_side, _] = log_sides(look, found);
        let about = log_side - at_size(&fitted.log_side, look.appearance.size_px);
        let sigma = at_size(&fitted.log_side_sigma, look.appearance.size_px).max(0.02);
        ((*run, look.thing), look.t_s, about / sigma)
    });
    let side = parts(sides.collect());
    Boxes {
        bias,
        spread,
        off,
        side,
        ..fitted
    }
}
