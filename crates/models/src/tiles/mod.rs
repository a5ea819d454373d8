//! 3D Tiles as mathematics: bounding volumes, screen-space error, selection, implicit tiling
//! (OGC 22-025r4, "3D Tiles Specification 1.1").

pub mod horizon;
pub mod implicit;
pub mod selection;
pub mod selector;
pub mod steady;
pub mod tree;
pub mod volume;
