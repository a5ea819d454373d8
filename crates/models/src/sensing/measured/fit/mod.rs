//! A measured detector from what was said in runs.

mod boxes;
mod data;
mod going_on;
mod middle;
mod names;
mod places;
mod regression;

pub use data::Run;

use super::scenery::Scenery;
use super::{KNOTS_PX, Kind, LookRow, Measured, NamedRow, Noise, Scores, TERMS, nearest};
use crate::optics::tier::Tier;
use crate::tracking::evidence::logit;
use boxes::boxes;
use data::{Data, SCENERY};
use going_on::{naming, parts};
use nalgebra::SVector;
use names::names;
use places::places;
use regression::{Side, regressed};

/// A look counts among those of noise where the thing is found with this chance: what is not found has no score.
const SURE: f64 = 0.9;
/// So many looks with the names at any size, and so many that no motion gave away, are taken as known beside the data at each.
const LOOKS_KNOWN: f64 = 20.0;

/// A model, and what it is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The model.
    pub model: Measured,
    /// Looks at UAVs, birds and other things that fly, false boxes, and answers of the recogniser.
    pub counts: [usize; 5],
}

/// The model that suits what was said in some runs by a detector with these classes and this neutral score; `of` says what was
/// measured. `None` without a look at a UAV.
pub fn fit(runs: &[Run], classes: Vec<String>, neutral: f64, of: String) -> Option<Fitted> {
    let data = Data::of(runs);
    let (_, first) = data.frames.first()?;
    let (floor, start) = (first.floor, first.start);
    if data.looks[0].is_empty() {
        return None;
    }
    let counts = [
        data.looks[0].len(),
        data.looks[1].len(),
        data.looks[2].len(),
        data.false_boxes.len(),
        data.named.iter().map(Vec::len).sum(),
    ];
    let uav = kind(&data.looks[0], &data.named[0], &classes, floor, None);
    let bird = kind(&data.looks[1], &data.named[1], &classes, floor, Some(&uav));
    let other = kind(&data.looks[2], &data.named[2], &classes, floor, Some(&uav));
    let of_tier = |tier| places(&data, tier, &classes);
    let model = Measured {
        of,
        floor,
        start,
        neutral,
        scenery: Scenery {
            search: of_tier(Tier::Search),
            coarse: of_tier(Tier::Coarse),
            precise: of_tier(Tier::Precise),
        },
        scenery_named: names(&data.named[SCENERY], None),
        classes,
        uav,
        bird,
        other,
    };
    Some(Fitted { model, counts })
}

fn kind(
    looks: &[(usize, &LookRow)],
    named: &[(usize, &NamedRow)],
    classes: &[String],
    floor: f64,
    like: Option<&Kind>,
) -> Kind {
    let scores = scores(looks, floor, like.map(|kind| &kind.scores));
    let mut shares = vec![[0.0; KNOTS_PX.len()]; classes.len()];
    let (mut moving, mut unseen) = ([0.0; KNOTS_PX.len()], [0.0; KNOTS_PX.len()]);
    for (_, look) in looks {
        let knot = nearest(look.appearance.size_px);
        match &look.found {
            Some(found) => {
                if let Some(label) = classes.iter().position(|class| *class == found.name) {
                    shares[label][knot] += 1.0;
                }
            }
            None if look.appearance.tier == Tier::Search => {
                unseen[knot] += 1.0;
                moving[knot] += f64::from(u8::from(look.moving));
            }
            None => {}
        }
    }
    for knot in 0..KNOTS_PX.len() {
        let sum: f64 = shares.iter().map(|shares| shares[knot]).sum();
        let all: Vec<f64> = shares.iter().map(|shares| shares.iter().sum()).collect();
        let total: f64 = all.iter().sum();
        for (shares, all) in shares.iter_mut().zip(all) {
            // Where little is known, as at any size.
            let like = LOOKS_KNOWN * all / f64::max(total, 1.0);
            shares[knot] = (shares[knot] + like) / (sum + LOOKS_KNOWN);
        }
        moving[knot] /= unseen[knot] + LOOKS_KNOWN;
    }
    Kind {
        naming: naming(looks),
        scores,
        named: shares,
        moving,
        boxes: boxes(looks, like.map(|kind| &kind.boxes)),
        recognised: names(named, like.map(|kind| &kind.recognised)),
    }
}

/// What is found by a probit regression, and how surely by a linear one of a normal variable that is cut off at the floor.
fn scores(looks: &[(usize, &LookRow)], floor: f64, like: Option<&Scores>) -> Scores {
    let cut = logit(floor);
    let terms = |look: &LookRow| SVector::from(look.appearance.terms());
    let all: Vec<(SVector<f64, TERMS>, Side)> = (looks.iter())
        .map(|(_, look)| {
            let side = if look.found.is_some() {
                Side::Above(0.0)
            } else {
                Side::Below(0.0)
            };
            (terms(look), side)
        })
        .collect();
    let mut at_floor = SVector::<f64, TERMS>::zeros();
    at_floor.fixed_rows_mut::<{ KNOTS_PX.len() }>(0).fill(cut);
    let (before_found, before_logit) = like.map_or((SVector::zeros(), at_floor), |like| {
        (SVector::from(like.found), SVector::from(like.logit))
    });
    let (found, _) = regressed(&all, before_found, Some(1.0));
    let scored: Vec<(SVector<f64, TERMS>, Side)> = (looks.iter())
        .filter_map(|(_, look)| {
            Some((
                terms(look),
                Side::Cut(logit(look.found.as_ref()?.score), cut),
            ))
        })
        .collect();
    let (mean, sigma) = regressed(&scored, before_logit, None);
    let mut fitted = Scores {
        found: found.into(),
        logit: mean.into(),
        sigma,
        noise: Noise::default(),
    };
    let residuals = looks.iter().filter_map(|(run, look)| {
        let score = logit(look.found.as_ref()?.score);
        let sure = fitted.chance(&look.appearance) > SURE;
        let key = (*run, look.thing, look.appearance.tier);
        sure.then(|| (key, look.t_s, score - fitted.mean(&look.appearance)))
    });
    fitted.noise = parts(residuals.collect());
    fitted
}

/// How well a model foretells the UAVs that are found in runs that it was not fitted to: at each knot of size that size [px],
/// how many looks there are, and the shares found, foretold and observed.
pub fn foretold(model: &Measured, runs: &[Run]) -> Vec<(f64, usize, f64, f64)> {
    let mut by_size = [(0_usize, 0.0, 0.0); KNOTS_PX.len()];
    for (_, look) in &Data::of(runs).looks[0] {
        let sums = &mut by_size[nearest(look.appearance.size_px)];
        sums.0 += 1;
        sums.1 += model.uav.scores.chance(&look.appearance);
        sums.2 += f64::from(u8::from(look.found.is_some()));
    }
    let shares = by_size.iter().zip(KNOTS_PX);
    let share = |sum: f64, count: usize| sum / count.max(1) as f64;
    shares
        .map(|((count, foretold, found), size_px)| {
            (
                size_px,
                *count,
                share(*foretold, *count),
                share(*found, *count),
            )
        })
        .collect()
}
