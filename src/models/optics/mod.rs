//! Cameras: projection, exposure, sensor, rasterised truth, calibration, detections.

pub mod calibration;
pub mod camera;
pub mod detection;
pub mod exposure;
pub mod raster;
pub mod sensor;
pub mod tier;
