//! What a scenario says becomes what the systems work with: plain functions without the engine, called by the set-up of
//! each domain, by `tune`, and by evaluations that have no run.

pub mod capture;
pub mod control;
pub mod environment;
pub mod mount;
pub mod operator;
pub mod track;
