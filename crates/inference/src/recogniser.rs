//! The recogniser: a network that says what a track is, from its last second.
//!
//! It takes `chips` f32 `[B, 16, 3, 24, 24]` (RGB 0 to 1), `features` f32 `[B, 16, F]` and `mask` f32
//! `[B, 16]` (1 where the track was seen) and gives `probabilities` f32 `[B, 6]`, calibrated. Its
//! metadata names classes and features, which must be those of
//! [`boresight_models::tracking::recognition`] (training/README.md).

use super::error::DetectorError;
use super::interface::{entry, fits, list};
use super::runtime::{Setup, first_line, session};
use boresight_models::optics::chip::CHIP_PX;
use boresight_models::tracking::recognition::{
    CLASSES, FEATURES, Recognition, STEPS, Sequence, TrackClass,
};
use boresight_scenario::Provider;
use ort::session::Session;
use ort::value::{Outlet, TensorElementType, TensorRef};
use std::path::{Path, PathBuf};

/// Version of the interface that this build speaks.
const INTERFACE: &str = "1";
/// The order of its sums must not depend on the machine, and a few tracks keep no more busy.
const THREADS: usize = 1;
/// Values of a chip.
const CHIP: usize = 3 * CHIP_PX * CHIP_PX;

/// Why a recogniser cannot be used.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RecogniserError {
    /// ONNX Runtime.
    #[error(transparent)]
    Runtime(#[from] DetectorError),
    /// The model file cannot be read.
    #[error(
        "recogniser {path}: cannot be read ({why}); name an existing .onnx file with {named_in}"
    )]
    Unreadable {
        /// The model file.
        path: PathBuf,
        /// What the system said.
        why: String,
        /// The argument or key that named it.
        named_in: &'static str,
    },
    /// The file is no model that the runtime takes, or it fails at work.
    #[error(
        "recogniser {path}: cannot be run ({why}); export it again with training/recogniser.py"
    )]
    Broken {
        /// The model file.
        path: PathBuf,
        /// What the runtime said.
        why: String,
    },
    /// The model does not have the documented inputs and outputs.
    #[error("recogniser {path}: {why}; see its interface in training/README.md")]
    Interface {
        /// The model file.
        path: PathBuf,
        /// What differs.
        why: String,
    },
}

/// A loaded recogniser.
pub struct OnnxRecogniser {
    session: Session,
    path: PathBuf,
}

impl OnnxRecogniser {
    /// Loads and checks the model at `path`, which `named_in` named.
    pub fn load(path: &Path, named_in: &'static str) -> Result<Self, RecogniserError> {
        let path = &boresight_common::data::found(path);
        let unreadable = |error: std::io::Error| RecogniserError::Unreadable {
            path: path.into(),
            why: error.to_string(),
            named_in,
        };
        if std::fs::metadata(path).map_err(unreadable)?.is_dir() {
            return Err(unreadable(std::io::ErrorKind::IsADirectory.into()));
        }
        std::fs::File::open(path).map_err(unreadable)?;
        let setup = Setup {
            threads: THREADS,
            provider: Provider::Cpu,
            named_in,
        };
        let session = session(&setup)?
            .commit_from_file(path)
            .map_err(|error| broken(path, &error))?;
        check(&session).map_err(|why| RecogniserError::Interface {
            path: path.into(),
            why,
        })?;
        let mut recogniser = Self {
            session,
            path: path.into(),
        };
        // Tracks of which nothing is known show a model that answers nonsense before the run starts.
        recogniser.recognise(&[Sequence::default(), Sequence::default()], 0.0)?;
        Ok(recogniser)
    }

    /// What each of some tracks is, given their last seconds, which end at `t_s` [s].
    pub fn recognise(
        &mut self,
        sequences: &[Sequence],
        t_s: f64,
    ) -> Result<Vec<Recognition>, RecogniserError> {
        if sequences.is_empty() {
            return Ok(Vec::new());
        }
        let count = sequences.len();
        let mut chips = vec![0.0_f32; count * STEPS * CHIP];
        let mut mask = vec![0.0_f32; count * STEPS];
        let mut features: Vec<f32> = Vec::with_capacity(count * STEPS * FEATURES.len());
        for (k, sequence) in sequences.iter().enumerate() {
            features.extend(sequence.features.iter().flatten());
            for (i, step) in sequence.steps.iter().enumerate() {
                if let Some(step) = step {
                    let at = k * STEPS + i;
                    mask[at] = 1.0;
                    planes(&step.chip, &mut chips[at * CHIP..(at + 1) * CHIP]);
                }
            }
        }
        let path = &self.path;
        let fail = |error: ort::Error| broken(path, &error);
        let shape = [count, STEPS, 3, CHIP_PX, CHIP_PX];
        let chips = TensorRef::from_array_view((shape, &chips[..])).map_err(fail)?;
        let shape = [count, STEPS, FEATURES.len()];
        let features = TensorRef::from_array_view((shape, &features[..])).map_err(fail)?;
        let mask = TensorRef::from_array_view(([count, STEPS], &mask[..])).map_err(fail)?;
        let inputs = ort::inputs!["chips" => chips, "features" => features, "mask" => mask];
        let outputs = self.session.run(inputs).map_err(fail)?;
        let (shape, values) = outputs["probabilities"]
            .try_extract_tensor::<f32>()
            .map_err(fail)?;
        if **shape != [count as i64, CLASSES as i64] {
            return Err(RecogniserError::Interface {
                path: path.clone(),
                why: format!("it gives probabilities {shape:?}, expected [{count}, {CLASSES}]"),
            });
        }
        (values.chunks_exact(CLASSES))
            .map(|row| {
                let mut probabilities = [0.0; CLASSES];
                for (p, value) in probabilities.iter_mut().zip(row) {
                    *p = f64::from(*value);
                }
                let sum: f64 = probabilities.iter().sum();
                let good = |p: &f64| (0.0..=1.0 + 1e-4).contains(p);
                if probabilities.iter().all(good) && (sum - 1.0).abs() < 1e-3 {
                    return Ok(Recognition { probabilities, t_s });
                }
                Err(RecogniserError::Interface {
                    path: path.clone(),
                    why: format!("it gives {row:?}, which are no probabilities"),
                })
            })
            .collect()
    }
}

fn broken(path: &Path, error: &ort::Error) -> RecogniserError {
    RecogniserError::Broken {
        path: path.into(),
        why: first_line(&error.to_string()),
    }
}

/// Red, green and blue plane, 0 to 1, of a chip.
fn planes(chip: &[u8], out: &mut [f32]) {
    let area = CHIP_PX * CHIP_PX;
    for (i, rgb) in chip.chunks_exact(3).enumerate().take(area) {
        for (plane, value) in rgb.iter().enumerate() {
            out[plane * area + i] = f32::from(*value) / 255.0;
        }
    }
}

/// In what a model differs from the interface.
fn check(session: &Session) -> Result<(), String> {
    let metadata = session.metadata().map_err(|error| error.to_string())?;
    let value = |key: &str, expected: &str| {
        let same = |found: &str| (found == expected).then_some(());
        entry(key, metadata.custom(key), expected, same)
    };
    value("boresight.recogniser", INTERFACE)?;
    let names = |key: &str, expected: &[&str]| {
        let same = |found: &str| {
            let found: Vec<String> = serde_json::from_str(found).ok()?;
            (found == expected).then_some(())
        };
        entry(key, metadata.custom(key), &expected.join(", "), same)
    };
    names("classes", &TrackClass::ALL.map(TrackClass::name))?;
    names("features", &FEATURES)?;
    let (steps, chip, features) = (STEPS as i64, CHIP_PX as i64, FEATURES.len() as i64);
    let inputs: [(&str, &[i64]); 3] = [
        ("chips", &[-1, steps, 3, chip, chip]),
        ("features", &[-1, steps, features]),
        ("mask", &[-1, steps]),
    ];
    has("input", session.inputs(), &inputs)?;
    let outputs: [(&str, &[i64]); 1] = [("probabilities", &[-1, CLASSES as i64])];
    has("output", session.outputs(), &outputs)
}

/// Whether a model has tensors of these names and shapes, for any number of tracks, and no others.
fn has(what: &str, outlets: &[Outlet], expected: &[(&str, &[i64])]) -> Result<(), String> {
    let good = |(name, shape): &(&str, &[i64])| {
        outlets.iter().any(|outlet| {
            outlet.name() == *name && fits(outlet.dtype(), TensorElementType::Float32, shape)
        })
    };
    if outlets.len() == expected.len() && expected.iter().all(good) {
        return Ok(());
    }
    let spelt: Vec<String> = (expected.iter())
        .map(|(name, shape)| format!("`{name}`, f32 {shape:?}").replace("-1", "B"))
        .collect();
    Err(format!(
        "its {what}s are {}; expected {}",
        list(outlets),
        spelt.join("; ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::tracking::recognition::{Glimpse, History};
    use glam::DVec2;

    fn path(name: &str) -> PathBuf {
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(name)
    }

    /// The models are those of training/make_broken_models.py.
    #[test]
    fn a_recogniser_that_differs_from_the_interface_is_refused_with_its_fault() {
        let cases: [(&str, &[&str]); 6] = [
            (
                "recogniser_absent",
                &["cannot be read", "recogniser.onnx_model"],
            ),
            ("truncated", &["cannot be run", "training/recogniser.py"]),
            (
                "wrong_inputs",
                &["boresight.recogniser is missing", "expected 1"],
            ),
            (
                "recogniser_features",
                &["its metadata features is [\"age_s\"]"],
            ),
            (
                "recogniser_inputs",
                &["`chips`, f32", "expected `chips`, f32 [B, 16, 3, 24, 24]"],
            ),
            ("recogniser_sum", &["which are no probabilities"]),
        ];
        for (name, words) in cases {
            let model = path(&format!("tests/data/models/{name}.onnx"));
            let found = OnnxRecogniser::load(&model, "recogniser.onnx_model");
            let error = found
                .err()
                .map(|error| error.to_string())
                .unwrap_or_default();
            for word in words {
                assert!(error.contains(word), "{name}: {error}");
            }
        }
    }

    #[test]
    fn the_shipped_recogniser_answers_alike_alone_and_in_company() {
        let model = path("assets/models/recogniser.onnx");
        let mut recogniser = OnnxRecogniser::load(&model, "test").unwrap();
        let sequence = |value: u8, rate_radps: f64| {
            let mut history = History::default();
            for frame in 0..16 {
                let t_s = f64::from(frame) / 16.0;
                let glimpse = Glimpse {
                    tick: 0,
                    t_s,
                    tier: boresight_models::optics::tier::Tier::Coarse,
                    az_el_rad: DVec2::new(rate_radps * t_s, 0.1),
                    centre_px: [50.0; 2],
                    size_px: [10.0, 6.0],
                    ifov_rad: 8e-5,
                    score: 0.7,
                    named: Some(TrackClass::Uav),
                };
                history.take(glimpse, || vec![value; CHIP].into());
            }
            history.sequence(15.0 / 16.0, 1.0, true).unwrap()
        };
        let both = [sequence(90, 5e-3), sequence(180, 0.0)];
        let together = recogniser.recognise(&both, 1.0).unwrap();
        for (alone, found) in both.iter().zip(&together) {
            let alone = recogniser
                .recognise(std::slice::from_ref(alone), 1.0)
                .unwrap();
            for (a, b) in alone[0].probabilities.iter().zip(found.probabilities) {
                assert!((a - b).abs() < 1e-5, "{alone:?} {found:?}");
            }
        }
        assert_ne!(together[0], together[1]);
    }
}
