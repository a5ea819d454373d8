//! Cameras: projection, exposure, sensor, rasterised truth, calibration, detections.

pub mod background;
pub mod calibration;
pub mod camera;
pub mod detection;
pub mod exposure;
pub mod glare;
pub mod mosaic;
pub mod motion;
pub mod noise;
pub mod pattern;
pub mod raster;
pub mod sensor;
pub mod tier;
