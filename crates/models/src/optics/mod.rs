//! Cameras: projection, exposure, sensor, background, calibration, chips, clutter, detections.

pub mod background;
pub mod calibration;
pub mod camera;
pub mod chip;
pub mod clutter;
pub mod detection;
pub mod exposure;
pub mod glare;
pub mod mosaic;
pub mod motion;
pub mod noise;
pub mod pattern;
pub mod registration;
pub mod seeing;
pub mod sensor;
pub mod stray;
pub mod tier;
pub mod tighten;
