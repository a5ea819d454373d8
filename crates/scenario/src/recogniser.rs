//! What says over time what a track is.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::DetectorConfig;
use super::check::Check;

/// A network that says over time what a track is: UAV, bird, aeroplane, helicopter, balloon, other.
/// It looks at pictures: beside the truth detector it rests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Recogniser")]
pub struct RecogniserConfig {
    /// The ONNX file, relative to the working directory or the program's data; empty: nothing is recognised; absent: the shipped
    /// one beside the shipped detector, from whose tracks it learned, and none beside another.
    pub onnx_model: Option<PathBuf>,
    /// How often it looks at tracks; must divide `tick_hz`.
    pub rate_hz: u32,
    /// Most tracks that it looks at each time: the target, then those that have waited longest.
    pub max_tracks: u32,
}

impl Default for RecogniserConfig {
    fn default() -> Self {
        Self {
            onnx_model: None,
            rate_hz: 16,
            max_tracks: 8,
        }
    }
}

impl RecogniserConfig {
    /// The file of the recogniser that works beside a detector.
    pub fn model(&self, detector: &DetectorConfig) -> Option<&Path> {
        const SHIPPED: &str = "assets/models/recogniser.onnx";
        let own = detector.onnx_model == DetectorConfig::default().onnx_model;
        let named = match &self.onnx_model {
            Some(file) => Some(file.as_path()),
            None => own.then(|| Path::new(SHIPPED)),
        };
        named.filter(|file| !file.as_os_str().is_empty() && detector.is_onnx())
    }

    /// Whether what was measured of a recogniser works beside a detector: beside its like, unless nothing is to be recognised.
    pub fn is_measured(&self, detector: &DetectorConfig) -> bool {
        let file = self.onnx_model.as_ref();
        detector.is_measured() && file.is_none_or(|file| !file.as_os_str().is_empty())
    }

    pub(super) fn check(&self, check: &mut Check, tick_hz: u32) {
        check.rate("rate_hz", self.rate_hz, tick_hz);
        check.within("max_tracks", self.max_tracks.into(), 1.0..=1024.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_one_works_beside_the_shipped_detector() {
        let shipped = DetectorConfig::default();
        let other = DetectorConfig {
            onnx_model: "other.onnx".into(),
            ..shipped.clone()
        };
        let truth = DetectorConfig {
            kind: crate::TRUTH.into(),
            ..shipped.clone()
        };
        let named = |file: Option<&str>| RecogniserConfig {
            onnx_model: file.map(PathBuf::from),
            ..Default::default()
        };
        let detectors = [&shipped, &other, &truth];
        let files = |file| {
            let config = named(file);
            detectors.map(|detector| config.model(detector).map(Path::to_path_buf))
        };
        let (default, own) = (
            "assets/models/recogniser.onnx".into(),
            PathBuf::from("own.onnx"),
        );
        assert_eq!(files(None), [Some(default), None, None]);
        assert_eq!(
            files(Some("own.onnx")),
            [Some(own.clone()), Some(own), None]
        );
        assert_eq!(files(Some("")), [None, None, None]);
    }
}
