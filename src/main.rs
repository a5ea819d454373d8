//! The `boresight` command.

use boresight::{cli, stop};
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match cli::run(cli::Cli::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            // Bad input of every kind ends with 2, so that scripts can tell it from a crash and from a stop.
            ExitCode::from(stop::asked().map_or(2, stop::Stop::exit_code))
        }
    }
}
