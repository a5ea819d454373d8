//! What sensors say of what is about: a radar's plots and tracks, dots that move in a camera's picture, and what a network was
//! measured to find.

pub mod measured;
pub mod moving;
pub mod radar;
