//! Instanced 3D models (i3dm): one glTF model at many places.

use crate::tiles::content::bytes::{Kind, u32_at};
use crate::tiles::content::error::ContentError;
use crate::tiles::content::gltf::{self, Setting};
use crate::tiles::content::model::{Content, Context, up};
use crate::tiles::content::place::{Stand, placed};
use crate::tiles::content::semantic::{directions, positions, vectors};
use crate::tiles::content::table::{Parts, Table};
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::shape::textured::PlacedMesh;
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Length of the header [byte].
const HEADER: usize = 32;

/// Decodes an i3dm, whose bytes end where it does.
pub(crate) fn decode(bytes: &[u8], context: &Context) -> Result<Content, ContentError> {
    let mut lengths = [0; 4];
    for (i, length) in lengths.iter_mut().enumerate() {
        *length = u32_at(bytes, 12 + 4 * i, "header")?;
    }
    let embedded = u32_at(bytes, 28, "header")?;
    let parts = Parts::new(bytes, HEADER, lengths, "header")?;
    let instances = Instances::new(&parts.features, bytes.len())?;
    let setting = Setting {
        outer: DAffine3::IDENTITY,
        inner: up(context.up_axis),
        rows: Vec::new(),
    };
    let mut content = match embedded {
        1 => gltf::decode(parts.body, setting, context),
        0 => {
            let uri = String::from_utf8_lossy(parts.body);
            let uri = uri.trim_matches(['\0', ' ']);
            let model = context.read(uri, "model")?;
            // What the model refers to lies beside it.
            let folder = uri.rsplit_once('/').map_or("", |(folder, _)| folder);
            let fetch = |other: &str| match folder {
                "" => (context.fetch)(other),
                _ if other.starts_with('/') || other.contains("://") => (context.fetch)(other),
                folder => (context.fetch)(&format!("{folder}/{other}")),
            };
            context.beside(&fetch, |context| gltf::decode(&model, setting, context))
        }
        other => {
            let why = format!("gltfFormat {other}, which is neither 0 nor 1");
            Err(ContentError::damaged("header", why))
        }
    }?;
    if !content.points.is_empty() {
        content.points.clear();
        content.note("points of instanced models are left out");
    }
    let first = content.features.len() as u32;
    if !parts.batch.is_empty() {
        let (rows, notes) = parts.batch.rows(instances.features, bytes.len(), context)?;
        content.features.extend(rows);
        notes.into_iter().for_each(|note| content.note(note));
    }
    let meshes = std::mem::take(&mut content.meshes);
    for PlacedMesh {
        mesh, placements, ..
    } in meshes
    {
        let stands = placements.len().saturating_mul(instances.to_content.len());
        context.spend(stands.saturating_mul(size_of::<Stand>()), "instances")?;
        let mut stands = Vec::with_capacity(stands);
        for (i, to_content) in instances.to_content.iter().enumerate() {
            let id = (!parts.batch.is_empty()).then(|| first + instances.id(i));
            stands.extend(placements.iter().map(|placement| Stand {
                to_content: *to_content * *placement,
                feature: id,
            }));
        }
        content
            .meshes
            .extend(placed(Arc::unwrap_or_clone(mesh), &stands));
    }
    Ok(content)
}

/// The instances of a tile.
struct Instances {
    to_content: Vec<DAffine3>,
    ids: Option<Vec<f64>>,
    /// Number of their features.
    features: usize,
}

impl Instances {
    fn new(table: &Table, bytes: usize) -> Result<Self, ContentError> {
        let damaged = |why: &str| ContentError::damaged("feature table", why);
        let count = table.count("INSTANCES_LENGTH")?;
        let count = count.ok_or_else(|| damaged("it has no INSTANCES_LENGTH"))?;
        if count > bytes {
            return Err(damaged("more instances than its bytes can hold"));
        }
        let center = table.vector("RTC_CENTER", Kind::F32)?.unwrap_or_default();
        let positions = positions(table, count)?;
        let positions =
            positions.ok_or_else(|| damaged("it has neither POSITION nor POSITION_QUANTIZED"))?;
        let east_north_up = table.flag("EAST_NORTH_UP");
        let axes = [
            directions(table, "NORMAL_RIGHT", count)?,
            directions(table, "NORMAL_UP", count)?,
        ];
        let scale = table.numbers("SCALE", 1, Kind::F32, count)?;
        let scales = vectors(table.numbers("SCALE_NON_UNIFORM", 3, Kind::F32, count)?);
        let ids = table.numbers("BATCH_ID", 1, Kind::U16, count)?;
        if ids
            .iter()
            .flatten()
            .any(|id| *id < 0.0 || *id as usize >= count)
        {
            return Err(damaged("a BATCH_ID is beyond the number of instances"));
        }
        let largest = ids.iter().flatten().fold(0.0, |a: f64, b| a.max(*b));
        let to_content = |i: usize| {
            let at = DVec3::from(center) + positions[i];
            let rotation = match &axes {
                [Some(right), Some(up)] => {
                    let (right, up) = (right[i], up[i]);
                    DMat3::from_cols(right, up, right.cross(up))
                }
                _ if east_north_up => {
                    DMat3::from_quat(SiteFrame::new(Geodetic::from_ecef(at)).q_ecef_enu())
                }
                _ => DMat3::IDENTITY,
            };
            let one = scale.as_ref().map_or(1.0, |all| all[i]);
            let each = scales.as_ref().map_or(DVec3::ONE, |all| all[i]);
            let matrix3 = rotation * DMat3::from_diagonal(one * each);
            DAffine3::from_mat3_translation(matrix3, at)
        };
        let to_content: Vec<_> = (0..count).map(to_content).collect();
        if !to_content.iter().all(|t| t.is_finite()) {
            return Err(damaged("an instance's place is not finite"));
        }
        Ok(Self {
            to_content,
            features: if ids.is_some() {
                largest as usize + 1
            } else {
                count
            },
            ids,
        })
    }

    /// The feature of an instance.
    fn id(&self, instance: usize) -> u32 {
        self.ids
            .as_ref()
            .map_or(instance as u32, |ids| ids[instance] as u32)
    }
}
