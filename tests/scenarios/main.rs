//! The shipped scenarios and bad input, through the real binary; the rendered truth, through the
//! library.
//!
//! Bevy's task pools are one per process, so what depends on the number of threads runs in
//! processes of its own; whatever renders takes [`common::rendering`], since a software rasteriser
//! uses every core already.

mod anywhere;
mod bad_input;
mod beam;
mod branches;
mod commands;
mod common;
mod determinism;
mod documents;
mod doors;
mod experiments;
mod flight;
mod live;
mod real_city;
mod real_pictures;
mod rendering;
mod serve;
mod shipped;
mod stations;
mod stopping;
mod stray;
mod structure;
mod swarms;
mod tiles;
mod tracking;
