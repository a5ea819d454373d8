//! What flies: catalogue, classes, rigid bodies with rotors, flight plans, distractors.

pub mod bird;
pub mod class;
pub mod distractor;
pub mod multirotor;
pub mod swarm;
pub mod trajectory;
pub mod uav;
