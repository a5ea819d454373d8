//! The `boresight` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(boresight::cli::program(std::env::args_os()))
}
