//! A check: what a model gives, against a reference.

use boresight_common::parallel::in_parallel;
use serde::Serialize;
use std::convert::Infallible;
use std::error::Error;
use std::time::{Duration, Instant};

/// Why a model gave no number, or the checks that are asked for do not exist.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// A model refused what a check gave it.
    #[error(transparent)]
    Model(#[from] Box<dyn Error + Send + Sync>),
    /// A model gave nothing where the check needs something.
    #[error("{0} gave nothing; its check and it no longer fit each other")]
    Nothing(&'static str),
    /// A model that has no checks.
    #[error("no check is of the model '{name}'; give one of: {known}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
}

impl Fault {
    /// What a model said.
    pub(crate) fn of(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Model(Box::new(error))
    }
}

/// How far a value may be from its reference, to either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// In the check's unit.
    Absolute(f64),
    /// As a share of the reference.
    Relative(f64),
}

impl Tolerance {
    /// In the check's unit, for a reference.
    pub fn absolute(self, value: f64) -> f64 {
        match self {
            Self::Absolute(bound) => bound,
            Self::Relative(share) => share * value.abs(),
        }
    }
}

/// What makes a check red: a constant that stands for the model's own, and by what it is multiplied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Mutation {
    /// The constant, in words.
    pub constant: &'static str,
    /// Its factor.
    pub factor: f64,
}

/// The factor of the constant that a check's mutation changes; 1 where nothing is mutated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale(f64);

impl Scale {
    /// A constant as the model is to have it.
    pub fn of(self, constant: f64) -> f64 {
        self.0 * constant
    }
}

/// A number that a model must give.
#[derive(Clone, Copy, Debug)]
pub struct Check {
    /// The model, by the name of its page in `docs/validation`.
    pub model: &'static str,
    /// What is compared.
    pub name: &'static str,
    /// Where the reference is from.
    pub reference: &'static str,
    /// The reference, in `unit`.
    pub value: f64,
    /// Unit of the values; empty for a pure number.
    pub unit: &'static str,
    /// How far off a value may be.
    pub tolerance: Tolerance,
    /// What must make it red.
    pub mutation: Mutation,
    /// What the model gives, in `unit`.
    pub run: fn(Scale) -> Result<f64, Fault>,
}

/// A fifth more of a constant, which is far beyond most tolerances.
pub(crate) const fn a_fifth_more(constant: &'static str) -> Mutation {
    times(constant, 1.2)
}

/// A constant times a factor.
pub(crate) const fn times(constant: &'static str, factor: f64) -> Mutation {
    Mutation { constant, factor }
}

/// Whether a value is within its tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It is.
    Green,
    /// It is not, or there is none.
    Red,
}

/// What a check found.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// The model, by the name of its page.
    pub model: &'static str,
    /// What was compared.
    pub name: &'static str,
    /// Where the reference is from.
    pub reference: &'static str,
    /// The reference.
    pub value: f64,
    /// What the model gave; none where it refused.
    pub ours: Option<f64>,
    /// Unit of both.
    pub unit: &'static str,
    /// How far off it may be, in that unit, to either side.
    pub tolerance: f64,
    /// Whether it is within that.
    pub verdict: Verdict,
    /// Why there is no value.
    pub refused: Option<String>,
    /// What was made of it that would have to be red.
    pub mutation: Mutation,
    /// How long it took.
    #[serde(skip)]
    pub took: Duration,
}

impl Check {
    /// What the model gives as it is.
    pub fn find(&self) -> Finding {
        self.find_with(Scale(1.0))
    }

    /// What it gives with its constant changed.
    pub fn find_mutated(&self) -> Finding {
        self.find_with(Scale(self.mutation.factor))
    }

    fn find_with(&self, scale: Scale) -> Finding {
        let started = Instant::now();
        let found = (self.run)(scale);
        let took = started.elapsed();
        let tolerance = self.tolerance.absolute(self.value);
        let (ours, refused) = match found {
            Ok(ours) => (Some(ours), None),
            Err(fault) => (None, Some(fault.to_string())),
        };
        let within = ours.is_some_and(|ours| (ours - self.value).abs() <= tolerance);
        Finding {
            model: self.model,
            name: self.name,
            reference: self.reference,
            value: self.value,
            ours,
            unit: self.unit,
            tolerance,
            verdict: match within {
                true => Verdict::Green,
                false => Verdict::Red,
            },
            refused,
            mutation: self.mutation,
            took,
        }
    }
}

/// Carries out checks on so many threads; findings come in their order.
pub fn run(checks: &[Check], threads: usize) -> Vec<Finding> {
    let found = in_parallel(checks, threads, |check| Ok::<_, Infallible>(check.find()));
    found.unwrap_or_else(|never| match never {})
}
