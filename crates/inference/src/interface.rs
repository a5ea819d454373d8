//! What a model says of itself, checked against the interface of training/README.md.

use boresight_models::optics::detection::Padding;
use boresight_models::tracking::evidence::NEUTRAL_SCORE;
use ort::session::Session;
use ort::value::{Outlet, TensorElementType, ValueType};

/// Version of the interface that this build speaks.
const INTERFACE: &str = "1";

/// What a model that keeps to the interface says of itself.
pub(super) struct Interface {
    /// Names of the classes.
    pub(super) classes: Vec<String>,
    /// Score from which on its maker recommends to believe a detection.
    pub(super) score_threshold: f64,
    /// The same on video of real cameras.
    pub(super) score_threshold_video: f64,
    /// Score of a detection that speaks neither for a UAV nor against it.
    pub(super) score_neutral: f64,
    /// How pictures are padded.
    pub(super) padding: Padding,
    /// Whether it takes several pictures at once.
    pub(super) batches: bool,
}

/// Sides of an input that memory holds [px].
const SIDES_PX: std::ops::RangeInclusive<u32> = 1..=8192;

impl Interface {
    /// What the model says of itself, or in what it differs from the interface.
    pub(super) fn of(session: &Session) -> Result<Self, String> {
        let metadata = session.metadata().map_err(|error| error.to_string())?;
        let text = |key: &str| metadata.custom(key);
        let value = |key: &str, expected: &str| {
            entry(key, text(key), expected, |found| {
                (found == expected).then_some(())
            })
        };
        value("boresight.interface", INTERFACE)?;
        value("preprocess", "native")?;
        let key = "classes";
        let classes = entry(key, text(key), "a JSON list of different names", |found| {
            let names: Vec<String> = serde_json::from_str(found).ok()?;
            let good = |i: usize| !names[i].is_empty() && !names[..i].contains(&names[i]);
            (!names.is_empty() && (0..names.len()).all(good)).then_some(names)
        })?;
        let side = |key| {
            entry(key, text(key), "1 to 8192 px", |found: &str| {
                found.parse().ok().filter(|side| SIDES_PX.contains(side))
            })
        };
        let (stride_px, min_side_px) = (side("stride")?, side("min_side_px")?);
        let key = "score_threshold";
        let share = |found: &str| {
            let score: f64 = found.parse().ok()?;
            (0.0..=1.0).contains(&score).then_some(score)
        };
        let score_threshold = entry(key, text(key), "a number from 0 to 1", share)?;
        let key = "score_threshold_video";
        let score_threshold_video = match text(key) {
            None => score_threshold,
            found => entry(key, found, "a number from 0 to 1", share)?,
        };
        let key = "score_neutral";
        let score_neutral = match text(key) {
            None => NEUTRAL_SCORE,
            found => entry(key, found, "a number above 0 and below 1", |found| {
                share(found).filter(|score| *score > 0.0 && *score < 1.0)
            })?,
        };
        let (batches, fixed_px) = input(session.inputs())?;
        check_outputs(session.outputs(), batches)?;
        Ok(Self {
            classes,
            score_threshold,
            score_threshold_video,
            score_neutral,
            padding: Padding {
                stride_px,
                min_side_px,
                fixed_px,
            },
            batches,
        })
    }
}

/// Whether a model takes several pictures at once, and width and height of its input where they are fixed.
fn input(inputs: &[Outlet]) -> Result<(bool, [Option<u32>; 2]), String> {
    let image = (inputs.first())
        .filter(|image| inputs.len() == 1 && image.name() == "image")
        .filter(|image| fits(image.dtype(), TensorElementType::Float32, &[1, 3, -1, -1]))
        .ok_or_else(|| {
            format!(
                "its inputs are {}; expected one input `image`, f32 [1, 3, H, W]",
                list(inputs)
            )
        })?;
    let fixed = |axis: usize| match image.dtype() {
        ValueType::Tensor { shape, .. } => u32::try_from(shape[axis]).ok(),
        _ => None,
    };
    let size_px = [fixed(3), fixed(2)];
    // Height before width, as the shape has them.
    let mut sides = size_px.into_iter().rev().flatten();
    if let Some(side) = sides.find(|side: &u32| !SIDES_PX.contains::<u32>(side)) {
        return Err(format!(
            "its input `image` has a side of {side} px, expected 1 to 8192 px"
        ));
    }
    Ok((fixed(0).is_none(), size_px))
}

/// Name, type, shape, and what is expected without batches and with them.
type Output = (
    &'static str,
    TensorElementType,
    &'static [i64],
    [&'static str; 2],
);

const OUTPUTS: [Output; 4] = [
    (
        "boxes",
        TensorElementType::Float32,
        &[-1, -1, 4],
        ["f32 [N, 4]", "f32 [B, N, 4]"],
    ),
    (
        "scores",
        TensorElementType::Float32,
        &[-1, -1],
        ["f32 [N]", "f32 [B, N]"],
    ),
    (
        "labels",
        TensorElementType::Int64,
        &[-1, -1],
        ["i64 [N]", "i64 [B, N]"],
    ),
    (
        "centres",
        TensorElementType::Float32,
        &[-1, -1, 2],
        ["f32 [N, 2] or none", "f32 [B, N, 2] or none"],
    ),
];

fn check_outputs(outputs: &[Outlet], batches: bool) -> Result<(), String> {
    for (name, element, shape, expected) in OUTPUTS {
        let shape = &shape[usize::from(!batches)..];
        let found = outputs.iter().find(|outlet| outlet.name() == name);
        let good = found.map_or(name == "centres", |outlet| {
            fits(outlet.dtype(), element, shape)
        });
        if !good {
            return Err(format!(
                "its outputs are {}; expected an output `{name}`, {}",
                list(outputs),
                expected[usize::from(batches)]
            ));
        }
    }
    Ok(())
}

pub(super) fn list(outlets: &[Outlet]) -> String {
    let outlets: Vec<_> = (outlets.iter())
        .map(|outlet| format!("`{}`, {}", outlet.name(), spelt(outlet.dtype())))
        .collect();
    outlets.join("; ")
}

/// A value of the model's metadata.
pub(super) fn entry<T>(
    key: &str,
    found: Option<String>,
    expected: &str,
    read: impl Fn(&str) -> Option<T>,
) -> Result<T, String> {
    let found = found.as_deref();
    (found.and_then(read)).ok_or_else(|| {
        let found = found.unwrap_or("missing");
        format!("its metadata {key} is {found}, expected {expected}")
    })
}

/// Whether a declared tensor can be of this type and shape, where -1 is any size. Outputs may be
/// declared without a shape.
pub(super) fn fits(declared: &ValueType, element: TensorElementType, wanted: &[i64]) -> bool {
    let ValueType::Tensor { ty, shape, .. } = declared else {
        return false;
    };
    let side = |(&found, &wanted): (&i64, &i64)| found == -1 || wanted == -1 || found == wanted;
    let same = shape.len() == wanted.len() && shape.iter().zip(wanted).all(side);
    *ty == element && (same || shape.is_empty() && wanted.len() < 4)
}

/// A declared type as errors spell it.
fn spelt(declared: &ValueType) -> String {
    let ValueType::Tensor {
        ty,
        shape,
        dimension_symbols,
    } = declared
    else {
        return declared.to_string();
    };
    let sides: Vec<String> = (shape.iter().enumerate())
        .map(|(i, side)| match dimension_symbols.get(i) {
            _ if *side >= 0 => side.to_string(),
            Some(name) if !name.is_empty() => name.clone(),
            _ => "?".into(),
        })
        .collect();
    format!("{ty} [{}]", sides.join(", "))
}
