//! What a set holds, in numbers.

use super::coco::{Annotation, Picture, SceneRecord};
use crate::models::flight::class::ObjectClass;
use crate::models::maths::quantile::quantile;
use serde::Serialize;
use std::collections::BTreeMap;

/// The numbers of a set.
#[derive(Debug, Serialize)]
pub struct Statistics {
    /// Pictures.
    pub images: usize,
    /// Boxes of UAVs that are asked for.
    pub annotations: usize,
    /// Boxes of distractors that are asked for.
    pub distractors: usize,
    /// Boxes of either that are not: too little or too faint, or not to be tightened. They count nowhere else.
    pub ignored: usize,
    /// Pictures without a UAV.
    pub negatives: usize,
    /// Boxes by category, distractors too.
    pub categories: BTreeMap<&'static str, usize>,
    /// Boxes by model, distractors too.
    pub models: BTreeMap<String, usize>,
    /// Pictures by background, where it is known: that of real ones is not, nor are motion, light and range.
    pub backgrounds: BTreeMap<String, usize>,
    /// Pictures with UAVs, by motion.
    pub motions: BTreeMap<String, usize>,
    /// UAVs' boxes by their long side [px].
    pub sizes: BTreeMap<&'static str, usize>,
    /// Distractors' boxes by their long side [px].
    pub distractor_sizes: BTreeMap<&'static str, usize>,
    /// Pictures by light.
    pub light: BTreeMap<&'static str, usize>,
    /// Quantiles of the long side [px]: 5, 25, 50, 75 and 95 %.
    pub long_side_px: [f64; 5],
    /// The commonest long side as a share of the picture's width.
    pub mode_width_share: f64,
    /// Quantiles of the range [m].
    pub range_m: [f64; 5],
    /// Pearson's correlations of the boxes' x, y, width and height over the picture's.
    pub correlations: [[f64; 4]; 4],
}

/// Sizes by the upper end of their bin [px].
pub const SIZES: [(&str, f64); 5] = [
    ("under 6 px", 6.0),
    ("6 to 12 px", 12.0),
    ("12 to 24 px", 24.0),
    ("24 to 48 px", 48.0),
    ("48 px and more", f64::INFINITY),
];

/// Longer side of a box [px].
pub fn long_px(seen: &Annotation) -> f64 {
    seen.bbox[2].max(seen.bbox[3])
}

/// A box over the picture: its centre and size, 0 to 1.
fn relative(image: &Picture, seen: &Annotation) -> [f64; 4] {
    let (width, height) = (f64::from(image.width), f64::from(image.height));
    let [x, y, w, h] = seen.bbox;
    [
        (x + 0.5 * w) / width,
        (y + 0.5 * h) / height,
        w / width,
        h / height,
    ]
}

/// Quantiles at 5, 25, 50, 75 and 95 %; zeros of nothing.
fn quantiles(mut values: Vec<f64>) -> [f64; 5] {
    values.sort_by(f64::total_cmp);
    [0.05, 0.25, 0.5, 0.75, 0.95].map(|share| quantile(&values, share).unwrap_or(0.0))
}

/// Pearson's correlation of two columns; 0 where one does not vary.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum()
    };
    let spread = (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt();
    if spread > 0.0 {
        sum(&|x, y| x * y) / spread
    } else {
        0.0
    }
}

/// The name under which a value stands in files.
pub fn named(value: impl Serialize) -> String {
    let value = serde_json::to_value(value).ok();
    let name = value.as_ref().and_then(|name| name.as_str());
    name.unwrap_or_default().into()
}

impl Statistics {
    /// Counts a set's records.
    pub fn of(records: &[&SceneRecord]) -> Self {
        let images = || records.iter().flat_map(|record| &record.images);
        let every = || images().flat_map(|image| &image.annotations);
        let all = || every().filter(|seen| !seen.ignore);
        let boxes = || all().filter(|seen| seen.class.is_uav());
        let mut statistics = Self {
            images: images().count(),
            annotations: boxes().count(),
            distractors: all().count() - boxes().count(),
            ignored: every().count() - all().count(),
            negatives: images().filter(|i| i.uavs().next().is_none()).count(),
            categories: ObjectClass::ALL.map(|class| (class.name(), 0)).into(),
            models: BTreeMap::new(),
            backgrounds: BTreeMap::new(),
            motions: BTreeMap::new(),
            sizes: SIZES.map(|(name, _)| (name, 0)).into(),
            distractor_sizes: SIZES.map(|(name, _)| (name, 0)).into(),
            light: BTreeMap::new(),
            long_side_px: quantiles(boxes().map(long_px).collect()),
            mode_width_share: 0.0,
            range_m: quantiles(
                boxes()
                    .filter_map(|seen| Some(seen.rendered?.range_m))
                    .collect(),
            ),
            correlations: [[0.0; 4]; 4],
        };
        for record in records {
            let Some(setting) = record.setting() else {
                continue;
            };
            let light = match setting.sun_elevation_deg {
                h if h >= 15.0 => "day",
                h if h >= 2.0 => "low sun",
                _ => "dusk",
            };
            *statistics.light.entry(light).or_default() += record.images.len();
            let background = statistics.backgrounds.entry(named(setting.background));
            *background.or_default() += record.images.len();
        }
        for image in images().filter(|image| image.uavs().next().is_some()) {
            if let Some(motion) = image.motion {
                *statistics.motions.entry(named(motion)).or_default() += 1;
            }
        }
        for seen in all() {
            let class = seen.class;
            *statistics.models.entry(seen.model.clone()).or_default() += 1;
            *statistics.categories.entry(class.name()).or_default() += 1;
            let sizes = if class.is_uav() {
                &mut statistics.sizes
            } else {
                &mut statistics.distractor_sizes
            };
            if let Some((size, _)) = SIZES.iter().find(|(_, below)| long_px(seen) < *below) {
                *sizes.entry(size).or_default() += 1;
            }
        }
        let columns = columns(records);
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate() {
                statistics.correlations[i][j] = correlation(a, b);
            }
        }
        let shares: Vec<f64> = images()
            .flat_map(|i| asked(i).map(|s| long_px(s) / f64::from(i.width)))
            .collect();
        statistics.mode_width_share = mode(&shares);
        statistics
    }
}

/// The commonest value: the middle of the fullest of bins of 0.004, seen through three of them.
fn mode(values: &[f64]) -> f64 {
    const BIN: f64 = 0.004;
    let mut counts = [0usize; 100];
    for value in values {
        counts[((value / BIN) as usize).min(99)] += 1;
    }
    let smooth = |i: usize| counts[i.saturating_sub(1)] + counts[i] + counts[(i + 1).min(99)];
    let fullest = (0..100).max_by_key(|i| (smooth(*i), 100 - i)).unwrap_or(0);
    (fullest as f64 + 0.5) * BIN
}

/// A picture's UAVs that are asked for.
fn asked(image: &Picture) -> impl Iterator<Item = &Annotation> {
    image.uavs().filter(|seen| !seen.ignore)
}

/// x, y, width and height of every UAV's box that is asked for.
pub fn columns(records: &[&SceneRecord]) -> [Vec<f64>; 4] {
    let mut columns = [const { Vec::new() }; 4];
    for image in records.iter().flat_map(|record| &record.images) {
        for seen in asked(image) {
            for (column, value) in columns.iter_mut().zip(relative(image, seen)) {
                column.push(value);
            }
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_and_quantiles_are_the_textbook_ones() {
        let a = [1.0, 2.0, 3.0, 4.0];
        assert!((correlation(&a, &[2.0, 4.0, 6.0, 8.0]) - 1.0).abs() < 1e-12);
        // By hand: the sums of products are 3 and 5, 5.
        assert!((correlation(&a, &[1.0, 3.0, 2.0, 4.0]) - 0.8).abs() < 1e-12);
        assert_eq!(correlation(&a, &[1.0; 4]), 0.0);
        assert_eq!(quantiles(vec![4.0, 1.0, 3.0, 2.0, 5.0])[2], 3.0);
        assert_eq!(quantiles(vec![10.0, 0.0]), [0.5, 2.5, 5.0, 7.5, 9.5]);
        assert_eq!(quantiles(Vec::new()), [0.0; 5]);
        assert!((mode(&[0.02, 0.021, 0.022, 0.05, 0.3]) - 0.022).abs() < 0.005);
    }
}
