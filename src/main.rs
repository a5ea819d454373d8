//! The `boresight` command.

use boresight::cli;
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match cli::run(cli::Cli::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            // Bad input of every kind ends with 2, so that scripts can tell it from a crash.
            ExitCode::from(2)
        }
    }
}
