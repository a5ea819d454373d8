//! Control laws of mount and mirror, and how their gains are derived. `law` is what they share, `tuned`,
//! `lqg` and `paper` are the laws, `pointing` is what the first two have in common, `tuning` measures loops.

pub mod law;
pub mod lqg;
pub mod paper;
pub mod pointing;
pub mod tuned;
pub mod tuning;

#[cfg(test)]
mod tests;
