#![doc = include_str!("../README.md")]

mod check;
mod checks;
mod comparison;
mod plots;
mod theory;

#[cfg(test)]
mod tests;

pub use check::{Check, Fault, Finding, Mutation, Scale, Tolerance, Verdict, run};
pub use checks::{all, of_models};
pub use comparison::{Case, Compared, cases, compare};
pub use plots::{Axis, Line, Plot, plots};
