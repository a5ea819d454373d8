//! glTF 2.0 (ISO/IEC 12113:2022), binary or JSON, with the extensions that tiles use.

mod document;
mod draco;
mod features;
mod look;
mod meshopt;
mod primitive;
mod schema;

use crate::tiles::content::bytes::Kind;
use crate::tiles::content::error::{ContentError, Fault};
use crate::tiles::content::model::{Content, Context, Rows};
use crate::tiles::content::place::{Stand, baked, baked_points, placed};
use boresight_models::shape::textured::PlacedMesh;
use document::{Document, extension, layout};
use features::{Features, Ids};
use glam::{DAffine3, DMat4, DQuat, DVec3};
use look::Looks;
use primitive::Drawn;
use schema::{Instancing, Node};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What surrounds a glTF model in its content.
pub(crate) struct Setting {
    /// From a frame with z up to the content's.
    pub outer: DAffine3,
    /// From the model's axes to a frame with z up.
    pub inner: DAffine3,
    /// The rows of the batch table around it.
    pub rows: Rows,
}

/// Decodes a glTF model.
pub(crate) fn decode(
    bytes: &[u8],
    setting: Setting,
    context: &Context,
) -> Result<Content, ContentError> {
    read(bytes, setting, context).map_err(|why| why.within("glTF"))
}

fn read(bytes: &[u8], setting: Setting, context: &Context) -> Result<Content, ContentError> {
    let document = Document::new(bytes, context)?;
    let looks = Looks::new(&document);
    let (mut features, notes) = Features::new(&document, setting.rows)?;
    let mut content = Content {
        notes,
        ..Content::default()
    };
    #[derive(serde::Deserialize, Default)]
    #[serde(default)]
    struct Rtc {
        center: [f64; 3],
    }
    let rtc: Rtc = extension(&document.root.extensions, "CESIUM_RTC", "glTF")?.unwrap_or_default();
    let center = DAffine3::from_translation(DVec3::from(rtc.center));
    let to_content = setting.outer * center * setting.inner;
    let stands = stands(&document, &mut features, to_content, &mut content)?;
    let mut wrong: Option<(u64, ContentError)> = None;
    for (index, stands) in stands {
        let place = format!("mesh {index}");
        let absent = || ContentError::damaged(&place, "there is none");
        let mesh = document.root.meshes.get(index).ok_or_else(absent)?;
        if mesh
            .primitives
            .iter()
            .any(|primitive| !primitive.targets.is_empty())
        {
            content.note("morph targets are left out");
        }
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("{place}, primitive {number}");
            let mut notes = Vec::new();
            let mut note = |text: &str| notes.push(text.to_owned());
            let drawn = primitive::read(
                &document,
                &looks,
                &mut features,
                primitive,
                &place,
                &mut note,
            );
            let drawn = match drawn {
                Ok(drawn) => drawn,
                // What is too large for one is too large for the content.
                Err(why) if matches!(why.fault, Fault::TooLarge { .. }) => return Err(why),
                Err(why) => {
                    wrong.get_or_insert((0, why)).0 += 1;
                    continue;
                }
            };
            notes.into_iter().for_each(|text| content.note(text));
            stand(&document, &mut content, drawn, &stands, &place)?;
        }
    }
    // One bad primitive does not cost the others.
    if let Some((count, why)) = wrong {
        if content.meshes.is_empty() && content.points.is_empty() {
            return Err(why);
        }
        content.note(format!(
            "{count} damaged primitives are left out, the first: {why}"
        ));
    }
    content.features = features.rows;
    Ok(content)
}

/// Puts what a primitive draws where it stands.
fn stand(
    document: &Document,
    content: &mut Content,
    drawn: Drawn,
    stands: &[Stand],
    place: &str,
) -> Result<(), ContentError> {
    let beyond = || ContentError::damaged(place, "its positions are beyond all numbers");
    match drawn {
        Drawn::Mesh(mesh) if mesh.indices.is_empty() => {}
        Drawn::Mesh(mesh) => match stands {
            [
                Stand {
                    to_content,
                    feature: None,
                },
            ] => {
                let mesh = baked(mesh, *to_content).ok_or_else(beyond)?;
                content.meshes.push(PlacedMesh {
                    mesh: Arc::new(mesh),
                    placements: vec![DAffine3::IDENTITY],
                    placement_features: Vec::new(),
                });
            }
            _ => {
                let size = size_of::<DAffine3>().saturating_mul(stands.len());
                document.spend(size, place)?;
                content.meshes.extend(placed(mesh, stands));
            }
        },
        Drawn::Points(cloud) if cloud.positions.is_empty() => {}
        Drawn::Points(cloud) => {
            for stand in stands {
                document.spend(cloud.positions.len().saturating_mul(44), place)?;
                let mut cloud = baked_points(cloud.clone(), stand.to_content).ok_or_else(beyond)?;
                if let Some(feature) = stand.feature {
                    cloud.features = vec![feature; cloud.positions.len()];
                }
                content.points.push(cloud);
            }
        }
        Drawn::Nothing => {}
    }
    Ok(())
}

/// A node's own transform.
fn transform(node: &Node) -> Option<DAffine3> {
    let own = match node.matrix {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix)),
        None => {
            let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
            DAffine3::from_scale_rotation_translation(
                DVec3::from(node.scale.unwrap_or([1.0; 3])),
                unit(rotation),
                DVec3::from(node.translation.unwrap_or_default()),
            )
        }
    };
    own.is_finite().then_some(own)
}

/// A rotation of a quaternion of any length.
fn unit(rotation: DQuat) -> DQuat {
    let length = rotation.length();
    if length.is_finite() && length > 0.0 {
        rotation / length
    } else {
        DQuat::IDENTITY
    }
}

/// Where each mesh of the scene stands, by the number of the mesh.
fn stands(
    document: &Document,
    features: &mut Features,
    to_content: DAffine3,
    content: &mut Content,
) -> Result<BTreeMap<usize, Vec<Stand>>, ContentError> {
    let root = &document.root;
    if root.scenes.len() > 1 {
        content.note("scenes but the first, or the one that is said to count, are left out");
    }
    let scene = root.scenes.get(root.scene.unwrap_or(0));
    let mut waiting: Vec<(usize, DAffine3)> = match scene {
        Some(scene) => scene.nodes.iter().rev().map(|n| (*n, to_content)).collect(),
        None if root.scene.is_some() => {
            return Err(ContentError::damaged(
                "scene",
                "there is none of its number",
            ));
        }
        None => {
            // A library of nodes: those that are nobody's children.
            let mut top = vec![true; root.nodes.len()];
            for child in root.nodes.iter().flat_map(|node| &node.children) {
                if let Some(top) = top.get_mut(*child) {
                    *top = false;
                }
            }
            let tops = top.iter().enumerate().filter(|(_, top)| **top);
            tops.map(|(n, _)| (n, to_content)).rev().collect()
        }
    };
    let mut found: BTreeMap<usize, Vec<Stand>> = BTreeMap::new();
    let mut seen = vec![false; root.nodes.len()];
    while let Some((index, to_parent)) = waiting.pop() {
        let place = format!("node {index}");
        let damaged = |why: &str| ContentError::damaged(&place, why);
        let node = root
            .nodes
            .get(index)
            .ok_or_else(|| damaged("there is none"))?;
        // A node has one parent; without this a circle of nodes would never end.
        if std::mem::replace(&mut seen[index], true) {
            return Err(damaged("it hangs below two nodes, or below itself"));
        }
        let visibility = node.extensions.get("KHR_node_visibility");
        if visibility.and_then(|it| it.get("visible")) == Some(&false.into()) {
            content.note("nodes that are hidden are left out");
            continue;
        }
        let own = transform(node).ok_or_else(|| damaged("its transform is not finite"))?;
        let to_content = to_parent * own;
        if !to_content.is_finite() {
            return Err(damaged("it stands beyond all numbers"));
        }
        if let Some(mesh) = node.mesh {
            if node.skin.is_some() {
                content.note("skins are left out: meshes stand as they are bound");
            }
            let stands = instances(document, features, node, to_content, content, &place)?;
            found.entry(mesh).or_default().extend(stands);
        }
        waiting.extend(node.children.iter().rev().map(|child| (*child, to_content)));
    }
    Ok(found)
}

/// Where a node's mesh stands: once, or as often as `EXT_mesh_gpu_instancing` says.
fn instances(
    document: &Document,
    features: &mut Features,
    node: &Node,
    to_content: DAffine3,
    content: &mut Content,
    place: &str,
) -> Result<Vec<Stand>, ContentError> {
    let name = "EXT_mesh_gpu_instancing";
    let instancing: Option<Instancing> = extension(&node.extensions, name, place)?;
    let Some(instancing) = instancing else {
        return Ok(vec![Stand {
            to_content,
            feature: None,
        }]);
    };
    let damaged = |why: String| ContentError::damaged(format!("{place}, {name}"), why);
    let mut count = None;
    let accessor = |name: &str| {
        let index = instancing.attributes.get(name).copied();
        index
            .map(|index| document.accessor(index, place))
            .transpose()
    };
    for name in instancing.attributes.keys() {
        let length = accessor(name)?.map_or(0, |accessor| accessor.count);
        if count.replace(length).is_some_and(|n| n != length) {
            return Err(damaged("its attributes are of different lengths".into()));
        }
    }
    let count = count.unwrap_or(0);
    let vectors = |name: &str| {
        let Some(accessor) = accessor(name)? else {
            return Ok(None);
        };
        match layout(accessor, place)? {
            (_, 3) => document.floats(accessor, [0.0; 3], place).map(Some),
            _ => Err(damaged(format!("{name} is no vector"))),
        }
    };
    let (translations, scales) = (vectors("TRANSLATION")?, vectors("SCALE")?);
    let rotations = match accessor("ROTATION")? {
        None => None,
        Some(accessor) => {
            // Integers are meant as numbers of -1..1 whether they say so or not.
            let (kind, components) = layout(accessor, place)?;
            if components != 4 {
                return Err(damaged("ROTATION is no quaternion".into()));
            }
            let unit = kind.unit();
            let read = |kind: Kind, bytes: &[u8]| document::floats(kind, unit, bytes, [0.0; 4]);
            Some(document.elements(accessor, [0.0; 4], read, place)?)
        }
    };
    let name = "EXT_instance_features";
    let (ids, note) = features.choose(&node.extensions, name, false, place)?;
    if let Some(note) = note {
        content.note(note);
    }
    let ids = match ids {
        Ids::Set(set) => {
            let raw = match set.attribute {
                None => (0..count as u32).collect(),
                Some(n) => {
                    let name = format!("_FEATURE_ID_{n}");
                    let found = accessor(&name)?;
                    let found = found.ok_or_else(|| damaged(format!("it has no {name}")))?;
                    document.whole(found, place)?
                }
            };
            Some(features.of_set(&set, raw, place)?)
        }
        _ => None,
    };
    document.spend(count.saturating_mul(size_of::<Stand>()), place)?;
    let vector = |all: &Option<Vec<[f32; 3]>>, i: usize, other: DVec3| match all {
        Some(all) => DVec3::from(all[i].map(f64::from)),
        None => other,
    };
    let stand = |i: usize| {
        let rotation = rotations
            .as_ref()
            .map(|all| DQuat::from_array(all[i].map(f64::from)));
        let own = DAffine3::from_scale_rotation_translation(
            vector(&scales, i, DVec3::ONE),
            rotation.map_or(DQuat::IDENTITY, unit),
            vector(&translations, i, DVec3::ZERO),
        );
        Stand {
            to_content: to_content * own,
            feature: ids.as_ref().map(|ids| ids[i]),
        }
    };
    let stands: Vec<_> = (0..count).map(stand).collect();
    if !stands.iter().all(|stand| stand.to_content.is_finite()) {
        return Err(damaged("an instance stands beyond all numbers".into()));
    }
    Ok(stands)
}
