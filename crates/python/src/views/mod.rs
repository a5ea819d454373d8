//! What can be read of a run between two ticks.

mod camera;
mod event;
mod mount;
mod station;
mod track;
mod truth;

pub use camera::Camera;
pub use event::Event;
pub use mount::{Beam, Mount};
pub use station::Station;
pub use track::Track;
pub use truth::{Air, Uav};

/// What a vector's docstring says of its shape.
macro_rules! shape {
    (two) => {
        "Shape [2]."
    };
    (three) => {
        "Shape [3]."
    };
}

/// A class of vectors: each a fresh array.
macro_rules! vectors {
    ($class:ident { $($(#[$doc:meta])* $name:ident: $kind:ident,)* } $($more:tt)*) => {
        #[pymethods]
        impl $class {
            $($(#[$doc])*
            #[doc = ""]
            #[doc = $crate::views::shape!($kind)]
            #[getter]
            fn $name<'py>(&self, py: Python<'py>) -> Vector<'py> {
                $kind(py, self.vectors().$name)
            })*
            $($more)*
        }
    };
}

use {shape, vectors};
