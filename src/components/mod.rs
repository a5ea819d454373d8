//! Data only: what entities are made of and what resources the systems share.

pub mod beam;
pub mod capture;
pub mod control;
pub mod detect;
pub mod engage;
pub mod environment;
pub mod flight;
pub mod mount;
pub mod network;
pub mod operator;
pub mod record;
pub mod render;
pub mod run;
pub mod track;
pub mod view;
