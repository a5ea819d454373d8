//! What flies: catalogue, rigid bodies with rotors, flight plans, distractors.

pub mod distractor;
pub mod multirotor;
pub mod trajectory;
pub mod uav;
