//! The layer of an IFC file's products.

use super::placing::ToEcef;
use super::products::{Made, Product};
use crate::sources::error::Fault;
use crate::sources::options::Options;
use crate::sources::surfaces::{Corner, Surfaces};
use crate::sources::{Layer, LayerKind};
use boresight_common::warning::Notes;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use glam::DVec3;
use ifc_lite_core::IfcType;
use serde_json::Value;

/// Linear albedo of a product.
fn albedo(kind: &IfcType) -> [f32; 4] {
    let [r, g, b] = match kind {
        IfcType::IfcRoof => [0.30, 0.16, 0.12],
        IfcType::IfcSlab => [0.30, 0.30, 0.29],
        IfcType::IfcWindow | IfcType::IfcCurtainWall => [0.08, 0.10, 0.12],
        IfcType::IfcDoor => [0.16, 0.10, 0.06],
        IfcType::IfcSite => [0.16, 0.18, 0.10],
        _ => [0.38, 0.34, 0.29],
    };
    [r, g, b, 1.0]
}

/// The layer of products; those without an area, or outside the system that they are in, are counted and left out.
pub fn layer(
    made: Made,
    to_ecef: &ToEcef,
    options: &Options,
    notes: &mut Notes,
) -> Result<Layer, Fault> {
    let [low, high] = made.bounds();
    let site = match options.site {
        Some(site) => site,
        None => {
            let middle = ((low + high) / 2.0).with_z(low.z);
            SiteFrame::new(Geodetic::from_ecef(to_ecef(middle)?))
        }
    };
    let mut surfaces = Surfaces::default();
    let mut features = Vec::with_capacity(made.products.len());
    let mut first = None;
    for product in made.products {
        let place = || {
            let name = product.known.get("name").and_then(Value::as_str);
            format!("{} '{}'", product.kind.name(), name.unwrap_or_default())
        };
        let faces = match placed(&product, &site, to_ecef) {
            Ok(faces) => faces,
            Err(fault) => {
                notes.leave_out("products outside the coordinate system", place());
                first.get_or_insert(fault);
                continue;
            }
        };
        let color = albedo(&product.kind);
        let feature = features.len() as u32;
        let mut any = product.kind == IfcType::IfcSpace;
        for rings in faces {
            any |= surfaces.polygon(&rings, feature, color, 0);
        }
        if any {
            features.push(product.known);
        } else {
            notes.leave_out("products whose faces have no area", place());
        }
    }
    surfaces.note(notes);
    let meshes = surfaces.finish();
    if meshes.is_empty() {
        let none = || Fault::new("IFC", "its faces have no area", "export it again");
        return Err(first.unwrap_or_else(none));
    }
    Ok(Layer {
        kind: LayerKind::Buildings,
        site,
        meshes,
        features,
        warnings: Vec::new(),
    })
}

/// A product's faces in the layer's frame [m].
fn placed(
    product: &Product,
    site: &SiteFrame,
    to_ecef: &ToEcef,
) -> Result<Vec<Vec<Vec<Corner>>>, Fault> {
    let corner = |r: &DVec3| Ok::<Corner, Fault>(site.ecef_to_enu(to_ecef(*r)?).into());
    let ring = |ring: &Vec<DVec3>| ring.iter().map(corner).collect::<Result<Vec<_>, _>>();
    let rings = |face: &Vec<Vec<DVec3>>| face.iter().map(ring).collect::<Result<Vec<_>, _>>();
    product.faces.iter().map(rings).collect()
}
