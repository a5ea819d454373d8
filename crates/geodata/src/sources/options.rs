//! What a user says about a source beside its file.

use boresight_models::maths::geodesy::SiteFrame;
use boresight_models::shape::textured::UpAxis;
use std::path::PathBuf;

/// What is known of a source beside its file; every reader takes what concerns it.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Its coordinate reference system (`EPSG:7415`, `EPSG:2056+5728`, a PROJ string), where the file names none or a wrong
    /// one.
    pub crs: Option<String>,
    /// Height of the geoid over the ellipsoid [m], in place of EGM96's at each point.
    pub geoid_height_m: Option<f64>,
    /// Parameters that place a local model on the Earth, as `boresight georef` writes them.
    pub georef: Option<PathBuf>,
    /// The frame of the layer; `None`: the middle of the source, on the ellipsoid's normal there, at its lowest height.
    pub site: Option<SiteFrame>,
    /// A picture from above for a height raster: a GeoTIFF, or a JPEG or PNG with a world file.
    pub orthophoto: Option<PathBuf>,
    /// A height raster that footprints stand on, or a folder of some.
    pub terrain: Option<PathBuf>,
    /// The terrain's coordinate reference system, where its file names none or a wrong one.
    pub terrain_crs: Option<String>,
    /// Height of the ground [m] under footprints, in the source's own vertical system, where no terrain is given.
    pub base_height_m: f64,
    /// Height [m] of a building whose source gives neither height nor storeys; `None`: 8 m.
    pub building_height_m: Option<f64>,
    /// Level of detail of a city model (`1`, `2.2`); `None`: the finest of each object.
    pub lod: Option<String>,
    /// Unit of an OBJ's or PLY's coordinates in words (`mm`, `ft`); `None`: metres, or that of its system.
    pub mesh_unit: Option<String>,
    /// Axis of an OBJ or PLY that points up; `None`: z.
    pub mesh_up: Option<UpAxis>,
}
