//! `boresight tiles …`: the commands about 3D Tiles.

pub mod build;

use crate::tiles::error::TilesError;
use crate::tiles::{inspect, validate};
use clap::Subcommand;

/// Why a command about tiles cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A tileset.
    #[error(transparent)]
    Tiles(#[from] TilesError),
    /// A build.
    #[error(transparent)]
    Build(#[from] build::CommandError),
}

/// The commands about 3D Tiles.
#[derive(Subcommand, Clone, Debug)]
pub enum Tiles {
    /// Turn raw geodata, or a scenario's generated city, into a tileset with levels of detail.
    Build(Box<build::Arguments>),
    /// Print the tree of a tileset, and what a camera would load of it.
    Inspect(inspect::Arguments),
    /// Say what is wrong with a tileset: one line a fault, with its place and its mend. Ends with 0 where nothing is,
    /// with 1 where something is, with 2 where it cannot be opened.
    Validate(validate::Arguments),
}

/// Carries a command out: what it says, and its exit code.
pub fn run(command: &Tiles) -> Result<(String, u8), CommandError> {
    match command {
        Tiles::Build(args) => Ok((build::run(args)?, 0)),
        Tiles::Inspect(args) => Ok((inspect::inspect(args)?, 0)),
        Tiles::Validate(args) => {
            let found = validate::validate(args)?;
            Ok((found.text(), found.exit_code()))
        }
    }
}
