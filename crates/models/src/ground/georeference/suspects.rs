//! Control points that do not belong with the others: exchanged or mistyped.
//!
//! Data snooping (Baarda, "A testing procedure for use in geodetic networks", 1968) over sets of up to three points: a set is
//! suspected when the others fit so much better without it that chance does not explain it.

use super::{ControlPoint, GeoreferenceError, Mode, Pairs, prepare};
use glam::DVec3;

/// What is wrong with control points, by their places in the list.
#[derive(Clone, Debug, PartialEq)]
pub enum Suspect {
    /// Two points whose places on the Earth are exchanged.
    Swapped(usize, usize),
    /// A point that lies elsewhere than the others say: by so much east, north and up [m] (as given less as fitted).
    Off(usize, DVec3),
}

/// Chance at which a set of good points is suspected.
const CHANCE: f64 = 1e-3;
/// Most sets of points that are tried at once.
const MOST_SETS: usize = 40_000;
/// Residuals below this share of the stated accuracy tell nothing: maps and geoids bend by millimetres, too.
const QUIET: f64 = 0.3;

/// Bound of the chance that good points fit better by the factor `q` (in squares) without the best of `sets` sets of `k`, with
/// `dof` degrees of freedom left: the tail of a beta distribution, whose other factor is at most one.
fn chance(q: f64, dof: usize, k: usize, sets: usize) -> f64 {
    let a = dof as f64 / 2.0;
    let half = (a + 1.25).sqrt();
    let constant = match k {
        1 => half / 0.886_227,
        2 => (a + 2.0) * (a + 1.0) / 2.0,
        _ => (a + 3.5) * (a + 2.5) * (a + 1.5) * half / 11.631_73,
    };
    q.powf(a) * constant * sets as f64
}

/// Number of sets of `k` out of `n`.
fn choose(n: usize, k: usize) -> usize {
    (0..k).fold(1, |product: usize, i| {
        product.saturating_mul(n - i) / (i + 1)
    })
}

/// All sets of `k` of `n` indices.
fn sets(n: usize, k: usize) -> Vec<Vec<usize>> {
    let mut found = vec![Vec::new()];
    for _ in 0..k {
        let longer = |set: &Vec<usize>| {
            let from = set.last().map_or(0, |last| last + 1);
            let set = set.clone();
            (from..n).map(move |next| [set.clone(), vec![next]].concat())
        };
        found = found.iter().flat_map(longer).collect();
    }
    found
}

/// The set of `k` points of `of` without which the others fit best, and their misfit.
fn best_without(pairs: &Pairs, mode: Mode, of: &[usize], k: usize) -> Option<(Vec<usize>, f64)> {
    let tried = sets(of.len(), k).into_iter().filter_map(|set| {
        let left: Vec<usize> = (0..of.len())
            .filter(|i| !set.contains(i))
            .map(|i| of[i])
            .collect();
        let found = pairs.closed_form(mode, &left)?;
        Some((
            set.iter().map(|&i| of[i]).collect(),
            pairs.misfit(&found, &left),
        ))
    });
    tried.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Points that do not belong with the others. Of `n` points at least one more than determine the fit must be good; with four,
/// only an exchange can be named.
pub fn suspects(points: &[ControlPoint], mode: Mode) -> Result<Vec<Suspect>, GeoreferenceError> {
    let (pairs, ..) = prepare(points, mode)?;
    let free = mode.free();
    let mut good: Vec<usize> = (0..points.len()).collect();
    let mut bad = Vec::new();
    let floor = |of: &[usize]| (3 * of.len()) as f64 * QUIET.powi(2);
    let misfit = |of: &[usize]| {
        let found = pairs.closed_form(mode, of);
        found.map_or(f64::INFINITY, |found| pairs.misfit(&found, of) + floor(of))
    };
    loop {
        // Best misfits without none, one, two, three points, as far as a degree of freedom and time are left.
        let mut without = vec![(Vec::new(), misfit(&good))];
        for k in 1..=3 {
            let dof = (3 * good.len()).saturating_sub(free + 3 * k);
            if dof == 0 || good.len() < k + mode.fewest() || choose(good.len(), k) > MOST_SETS {
                break;
            }
            let Some((set, least)) = best_without(&pairs, mode, &good, k) else {
                break;
            };
            without.push((set, least + floor(&good)));
        }
        let better = |from: usize, to: usize| {
            let dof = 3 * (good.len() - to) - free;
            let q = without[to].1 / without[from].1;
            chance(q, dof, to - from, choose(good.len(), to)) < CHANCE
        };
        // The smallest set beyond which nothing is gained.
        let last = without.len() - 1;
        let k = (0..=last)
            .find(|&k| (k + 1..=last).all(|more| !better(k, more)))
            .unwrap_or(last);
        if k == 0 || bad.len() + k > points.len() / 2 {
            break;
        }
        let set = without.swap_remove(k).0;
        good.retain(|i| !set.contains(i));
        bad.extend(set);
    }
    bad.sort_unstable();
    Ok(explain(&pairs, mode, &good, bad, &misfit))
}

/// Tells exchanged points from others.
fn explain(
    pairs: &Pairs,
    mode: Mode,
    good: &[usize],
    mut bad: Vec<usize>,
    misfit: &dyn Fn(&[usize]) -> f64,
) -> Vec<Suspect> {
    let mut found = Vec::new();
    let swapped_misfit = |i: usize, j: usize, of: &[usize]| {
        let mut swapped = Pairs {
            local: pairs.local.clone(),
            enu_m: pairs.enu_m.clone(),
            sigma_m: pairs.sigma_m.clone(),
        };
        swapped.enu_m.swap(i, j);
        let fitted = swapped.closed_form(mode, of);
        fitted.map_or(f64::INFINITY, |fitted| swapped.misfit(&fitted, of))
    };
    let dof = |n: usize| (3 * n).saturating_sub(mode.free()).max(1) as f64;
    let alone = misfit(good) / dof(good.len());
    for pair in sets(bad.len(), 2) {
        let (Some(&i), Some(&j)) = (bad.get(pair[0]), bad.get(pair[1])) else {
            continue;
        };
        if i == usize::MAX || j == usize::MAX {
            continue;
        }
        let with: Vec<usize> = good.iter().copied().chain([i, j]).collect();
        // As good with the two exchanged as without them.
        if swapped_misfit(i, j, &with) / dof(with.len()) < 6.0 * alone {
            found.push(Suspect::Swapped(i, j));
            bad[pair[0]] = usize::MAX;
            bad[pair[1]] = usize::MAX;
        }
    }
    if bad.is_empty() && good.len() < 6 && good.len() > mode.fewest() {
        // Too few to leave two out: an exchange shows by itself.
        let mut swaps: Vec<(f64, usize, usize)> = (sets(good.len(), 2).into_iter())
            .map(|pair| {
                (
                    swapped_misfit(good[pair[0]], good[pair[1]], good),
                    good[pair[0]],
                    good[pair[1]],
                )
            })
            .collect();
        swaps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (before, [best, next]) = (misfit(good), [swaps[0], swaps[1]]);
        if best.0 < 1e-4 * before && best.0 < 0.01 * next.0 {
            found.push(Suspect::Swapped(best.1, best.2));
        }
    }
    if let Some(fitted) = pairs.closed_form(mode, good) {
        let off = |i: usize| Suspect::Off(i, pairs.enu_m[i] - fitted.apply(pairs.local[i]));
        found.extend(bad.into_iter().filter(|i| *i != usize::MAX).map(off));
    }
    found
}
