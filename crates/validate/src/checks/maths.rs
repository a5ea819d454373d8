//! Statistics, random streams, assignment.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use boresight_models::engage::allocation::{AllocationRule, Bid, Offer, allocate};
use boresight_models::maths::assignment::{Pair, assign};
use boresight_models::maths::quantile::quantile;
use boresight_models::maths::rng::Stream;
use boresight_models::maths::statistics::{Mean, Rate, least_share};

pub fn checks() -> Vec<Check> {
    [statistics(), streams(), assignment()].concat()
}

fn statistics() -> Vec<Check> {
    vec![
        Check {
            model: "detector-metrics",
            name: "Wilson interval of 81 in 263, lower end",
            reference: "Newcombe, Statistics in Medicine 17, 857, 1998, table I",
            value: 0.2553,
            unit: "",
            tolerance: Tolerance::Absolute(6e-5),
            mutation: a_fifth_more("successes"),
            run: |scale| Ok(Rate::of(scale.of(81.0).round() as usize, 263).interval_95[0]),
        },
        Check {
            model: "detector-metrics",
            name: "half of the interval of the mean of 1 to 5",
            reference: "Student's t, 2.776445 of four degrees of freedom",
            value: 2.776_445 * 0.5f64.sqrt(),
            unit: "",
            tolerance: Tolerance::Relative(1e-6),
            mutation: a_fifth_more("spread of the samples"),
            run: |scale| {
                let samples = [1.0, 2.0, 3.0, 4.0, 5.0].map(|x| scale.of(x));
                Mean::of(&samples).half_95.ok_or(Fault::Nothing("Mean::of"))
            },
        },
        Check {
            model: "detector-metrics",
            name: "share that 20 of 20 show with 95 %",
            reference: "Clopper and Pearson: 0.05^(1/20)",
            value: 0.05f64.powf(0.05),
            unit: "",
            tolerance: Tolerance::Absolute(1e-9),
            mutation: a_fifth_more("trials"),
            run: |scale| {
                let trials = scale.of(20.0).round() as usize;
                Ok(least_share(trials, trials, 0.95))
            },
        },
        Check {
            model: "detector-metrics",
            name: "90 % quantile of 1, 2, 4, 8",
            reference: "Hyndman and Fan's rule 7, R's quantile()",
            value: 6.8,
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: times("share", 0.8),
            run: |scale| {
                let found = quantile(&[1.0, 2.0, 4.0, 8.0], scale.of(0.9));
                found.ok_or(Fault::Nothing("quantile"))
            },
        },
    ]
}

/// Mean of a power of 200,000 normal numbers.
fn normal_moment(power: i32, sigma: f64) -> f64 {
    const DRAWS: u32 = 200_000;
    let mut stream = Stream::new(7, 0, "validate");
    let sum: f64 = (0..DRAWS)
        .map(|_| (sigma * stream.normal()).powi(power))
        .sum();
    sum / f64::from(DRAWS)
}

fn streams() -> Vec<Check> {
    vec![
        Check {
            model: "random-streams",
            name: "variance of 200,000 normal numbers",
            reference: "standard normal, five standard errors",
            value: 1.0,
            unit: "",
            tolerance: Tolerance::Absolute(0.016),
            mutation: a_fifth_more("the numbers"),
            run: |scale| Ok(normal_moment(2, scale.of(1.0))),
        },
        Check {
            model: "random-streams",
            name: "fourth moment of 200,000 normal numbers",
            reference: "standard normal, five standard errors",
            value: 3.0,
            unit: "",
            tolerance: Tolerance::Absolute(0.11),
            mutation: a_fifth_more("the numbers"),
            run: |scale| Ok(normal_moment(4, scale.of(1.0))),
        },
        Check {
            model: "random-streams",
            name: "mean of 200,000 Poisson counts of mean 2.5",
            reference: "Poisson, five standard errors",
            value: 2.5,
            unit: "",
            tolerance: Tolerance::Absolute(0.018),
            mutation: a_fifth_more("mean that is asked for"),
            run: |scale| {
                let mut stream = Stream::new(8, 0, "validate");
                let mean = scale.of(2.5);
                let sum: u64 = (0..200_000).map(|_| stream.poisson(mean)).sum();
                Ok(sum as f64 / 200_000.0)
            },
        },
    ]
}

/// Costs of six tracks and six detections, all allowed.
fn costs() -> Vec<Pair> {
    let mut rng = Stream::new(5, 0, "assignment");
    let at = |k: usize| Pair {
        row: k / 6,
        column: k % 6,
        cost: rng.range(-10.0, -1.0),
    };
    (0..36).map(at).collect()
}

/// Least total by trying all permutations.
fn least_total(pairs: &[Pair], row: usize, taken: &mut Vec<usize>) -> f64 {
    let of_row = pairs.iter().filter(|pair| pair.row == row);
    let mut least = f64::INFINITY;
    for pair in of_row {
        if !taken.contains(&pair.column) {
            taken.push(pair.column);
            least = least.min(pair.cost + least_total(pairs, row + 1, taken));
            taken.pop();
        }
    }
    if row == 6 { 0.0 } else { least }
}

/// Total of the assignment of least cost, the cost of what it would have without the change times a factor.
fn assigned_total(factor: f64) -> f64 {
    let pairs = costs();
    let changed = |pair: &Pair| Pair {
        cost: factor * pair.cost,
        ..*pair
    };
    let changed: Vec<Pair> = pairs.iter().map(changed).collect();
    let chosen = assign(6, 6, &changed);
    let of = |pair: &&Pair| chosen[pair.row] == Some(pair.column);
    changed.iter().filter(of).map(|pair| pair.cost).sum()
}

/// Product over two stations of (time to the asset) times (time until engaged) by a rule [s⁴], where greed costs five times
/// as much; the first station's time to its cheaper target is so long [s].
fn allocated(rule: AllocationRule, first_s: f64) -> Result<f64, Fault> {
    let times_s = [[first_s, 4.0], [9.0, 60.0]];
    let bids: Vec<Bid> = (0..4)
        .map(|k| Bid {
            station: k / 2,
            target: k % 2,
            offer: Offer {
                engaged_s: times_s[k / 2][k % 2],
                steady: true,
            },
        })
        .collect();
    let chosen = allocate(rule, 2, &[10.0; 2], &bids, &[], 1.5);
    let mut product = 1.0;
    for (station, target) in chosen.iter().enumerate() {
        let target = target.ok_or(Fault::Nothing("allocate"))?;
        product *= 10.0 * times_s[station][target];
    }
    Ok(product)
}

fn assignment() -> Vec<Check> {
    vec![
        Check {
            model: "track-table",
            name: "least cost of six tracks and six detections",
            reference: "all permutations",
            value: least_total(&costs(), 0, &mut Vec::new()),
            unit: "",
            tolerance: Tolerance::Absolute(1e-9),
            mutation: a_fifth_more("costs"),
            run: |scale| Ok(assigned_total(scale.of(1.0))),
        },
        Check {
            model: "threat-and-target-choice",
            name: "product of times of two stations' least cost, where greed takes five times as much",
            reference: "by hand: 40 · 90 against 30 · 600",
            value: 3600.0,
            unit: "s⁴",
            tolerance: Tolerance::Relative(1e-12),
            mutation: times("first station's time to its cheaper target", 0.1),
            run: |scale| allocated(AllocationRule::LeastCost, scale.of(3.0)),
        },
    ]
}
