//! Cameras: projection, sensor, rasterised truth, calibration, chips, detections.

pub mod calibration;
pub mod camera;
pub mod chip;
pub mod detection;
pub mod raster;
pub mod sensor;
pub mod tier;
