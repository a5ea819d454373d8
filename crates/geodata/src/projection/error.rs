//! Why coordinates cannot be understood.

/// Why coordinates cannot be understood.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CrsError {
    /// A name that is no coordinate reference system known here.
    #[error(
        "'{0}' is no coordinate reference system known here; write EPSG:7415, EPSG:2056+5728, EPSG:25832+ellipsoid, WGS84 or a PROJ string (+proj=utm +zone=32 +ellps=GRS80)"
    )]
    Unknown(String),
    /// A vertical system that is not known.
    #[error(
        "'{0}' is no vertical system known here; write +ellipsoid (over WGS 84's) or +geoid (over EGM96's) in its place, with --geoid-height where its height over the ellipsoid is known"
    )]
    Vertical(String),
    /// Depths.
    #[error(
        "'{code}' ({name}) counts depths downwards; turn the sign of the values and name a system of heights (a code, or +geoid)"
    )]
    Depth {
        /// Its code.
        code: u32,
        /// Its name.
        name: &'static str,
    },
    /// Heights over an ellipsoid that is not WGS 84's.
    #[error(
        "'{code}' means heights over the ellipsoid {name}; bring them to WGS 84's, or write +ellipsoid or +geoid where the file says it wrongly"
    )]
    Ellipsoid {
        /// Its code.
        code: u32,
        /// The ellipsoid.
        name: &'static str,
    },
    /// A projection that cannot be worked out.
    #[error("'{name}': {what}; give the coordinates in another system, EPSG:4979 for instance")]
    Unsupported {
        /// The system.
        name: String,
        /// What is not supported.
        what: String,
    },
    /// Coordinates outside the system's domain.
    #[error(
        "({x}, {y}, {z}) is no point of {name}; check the system and the order of the coordinates (east or longitude first)"
    )]
    Outside {
        /// The system.
        name: String,
        /// East, longitude or X, as it was given.
        x: f64,
        /// North, latitude or Y.
        y: f64,
        /// Height or Z.
        z: f64,
    },
    /// What cannot lie on the Earth.
    #[error(
        "({x}, {y}, {z}) of {name} cannot lie on the Earth: {why}; check the system, the order of the columns and their unit"
    )]
    OffEarth {
        /// The system.
        name: String,
        /// East, longitude or X, as it was given.
        x: f64,
        /// North, latitude or Y.
        y: f64,
        /// Height or Z.
        z: f64,
        /// What is wrong with it.
        why: String,
    },
}
