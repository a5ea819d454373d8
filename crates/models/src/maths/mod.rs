//! Mathematics that belongs to no domain: rotations, random streams and fields, polygons, geodesy,
//! assignment, first- and second-order systems, frequency responses, quantiles, spreads,
//! rates and means with intervals, logistic regression.

pub mod assignment;
pub mod curve;
pub mod first_order;
pub mod frequency;
pub mod geodesy;
pub mod kinematics;
pub mod logistic;
pub mod noise;
pub mod polygon;
pub mod quantile;
pub mod rng;
pub mod second_order;
pub mod spread;
pub mod statistics;
