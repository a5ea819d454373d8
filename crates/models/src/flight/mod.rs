//! What flies: catalogue, classes, rigid bodies with rotors, flight plans, distractors, and what falls.

pub mod bird;
pub mod class;
pub mod distractor;
pub mod fall;
pub mod guided;
pub mod multirotor;
pub mod navigation;
pub mod shape;
pub mod swarm;
pub mod trajectory;
pub mod uav;
