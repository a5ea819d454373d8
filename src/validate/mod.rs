//! `boresight validate`: every model against closed forms and published values, as a table and a page.

mod found;
mod page;

pub use found::Validation;

use crate::output::{self, OutputError};
use boresight_common::parallel;
use boresight_validate::{Fault, cases, compare, of_models, plots, run};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Why models cannot be checked.
#[derive(Debug, thiserror::Error)]
pub enum ValidateError {
    /// A model that has no checks.
    #[error("--only: {0}")]
    Checks(Fault),
    /// A comparison that a model refused.
    #[error("--thorough: {0}")]
    Compare(Fault),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// What was found cannot be written as JSON.
    #[error("cannot be encoded: {0}; this is a fault of the program: please report it")]
    Json(#[from] serde_json::Error),
}

/// What to check, and where to.
#[derive(clap::Args, Clone, Debug)]
pub struct Arguments {
    /// Folder for report.html, checks.json and the plots.
    #[arg(long, default_value = "out/validate")]
    pub out: PathBuf,
    /// Only the checks of this model, by the name of its page in docs/validation, such as `propagation`; may be repeated.
    #[arg(long, value_name = "MODEL")]
    pub only: Vec<String>,
    /// Print checks.json instead of the table.
    #[arg(long)]
    pub json: bool,
    /// Also compare `scaling` with `wave` over range, Cn², aperture and wind, and draw plots from more waves: many minutes.
    #[arg(long)]
    pub thorough: bool,
    /// Worker threads (default: all cores); changes no result.
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Carries out the checks and writes page, numbers and plots.
///
/// # Errors
/// An unknown model, or a folder that cannot be written.
pub fn validate(args: &Arguments) -> Result<Validation, ValidateError> {
    let checks = of_models(&args.only).map_err(ValidateError::Checks)?;
    output::writable(&args.out.join("checks.json"))?;
    let threads = parallel::threads(args.threads);
    let is_wanted = args.only.is_empty() || args.only.iter().any(|name| name == "propagation");
    let validation = Validation {
        version: crate::VERSION,
        checks: run(&checks, threads),
        scaling_against_wave: match args.thorough && is_wanted {
            true => compare(&cases(), threads).map_err(ValidateError::Compare)?,
            false => Vec::new(),
        },
        plots: plots(&args.only, args.thorough, threads),
    };
    output::put(&args.out.join("checks.json"), validation.json()? + "\n")?;
    output::put(&args.out.join("report.html"), page::page(&validation))?;
    for (file, svg) in page::files(&validation) {
        output::put(&args.out.join(file), svg)?;
    }
    Ok(validation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_checked_is_left_as_page_numbers_and_plots() {
        let folder = tempfile::tempdir().unwrap();
        let args = Arguments {
            out: folder.path().join("validation"),
            only: vec!["geodesy".into(), "turbulence".into()],
            json: false,
            thorough: false,
            threads: None,
        };
        let validation = validate(&args).unwrap();
        assert_eq!((validation.red(), validation.exit_code()), (0, 0));
        let read = |name: &str| std::fs::read_to_string(args.out.join(name)).unwrap();
        let json: serde_json::Value = serde_json::from_str(&read("checks.json")).unwrap();
        let checks = json["checks"].as_array().unwrap();
        assert_eq!(checks.len(), validation.checks.len());
        assert!(checks.iter().all(|check| check["verdict"] == "green"));
        let page = read("report.html");
        assert!(page.contains("EPSG Guidance Note 7-2") && page.contains("<svg"));
        assert!(read("long-term.svg").starts_with("<svg"));
        let text = validation.text();
        assert!(
            text.contains("12.065") && text.contains("checks green"),
            "{text}"
        );
    }

    #[test]
    fn a_red_check_ends_with_1_and_an_unknown_model_is_named() {
        let check = boresight_validate::all()[0];
        let validation = Validation {
            version: "0",
            checks: vec![check.find(), check.find_mutated()],
            scaling_against_wave: Vec::new(),
            plots: Vec::new(),
        };
        assert_eq!((validation.red(), validation.exit_code()), (1, 1));
        assert!(validation.text().contains("RED") && validation.text().contains("1 of 2"));
        assert!(page::page(&validation).contains("1 of 2"));
        let args = Arguments {
            out: PathBuf::from("/nonexistent"),
            only: vec!["moon".into()],
            json: false,
            thorough: false,
            threads: None,
        };
        let said = validate(&args).unwrap_err().to_string();
        assert!(
            said.starts_with("--only: no check is of the model 'moon'"),
            "{said}"
        );
    }
}
