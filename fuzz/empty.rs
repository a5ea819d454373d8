//! Nothing: this package only builds its dependency.
