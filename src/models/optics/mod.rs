//! Cameras: projection, sensor, rasterised truth, calibration, detections.

pub mod background;
pub mod calibration;
pub mod camera;
pub mod detection;
pub mod raster;
pub mod sensor;
pub mod tier;
