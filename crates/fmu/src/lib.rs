#![doc = include_str!("../README.md")]
#![allow(non_snake_case)] // The standard names its functions.

mod access;
mod calls;
mod guard;
mod refused;
mod station;

pub use access::*;
pub use calls::*;
pub use refused::*;
