//! Data only: what entities are made of and what resources the systems share.

pub mod beam;
pub mod camera;
pub mod clock;
pub mod environment;
pub mod record;
pub mod render;
pub mod station;
pub mod track;
pub mod uav;
pub mod view;
