//! Buildings of an OpenStreetMap extract (`.osm.pbf`), through `osmpbf`.

use super::outline::Footprint;
use super::pbf;
use crate::models::maths::polygon;
use crate::sources::error::Fault;
use crate::warning::Notes;
use glam::DVec2;
use osmpbf::{Element, ElementReader, RelMemberType};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A building: its outer and inner ways.
struct Building {
    outer: Vec<i64>,
    inner: Vec<i64>,
    known: Map<String, Value>,
    name: String,
}

/// Whether a tag makes an element a building or a part of one.
fn is_building((key, value): (&str, &str)) -> bool {
    matches!(key, "building" | "building:part") && value != "no"
}

fn tags<'a>(all: impl Iterator<Item = (&'a str, &'a str)>) -> Map<String, Value> {
    all.map(|(key, value)| (key.to_string(), Value::from(value)))
        .collect()
}

/// Walks over the elements of a file.
fn walk(bytes: &[u8], visit: impl FnMut(Element<'_>)) -> Result<(), Fault> {
    let mend = "fetch the extract again";
    // The library panics on some damaged blocks.
    let walked = catch_unwind(AssertUnwindSafe(|| {
        ElementReader::new(Cursor::new(bytes)).for_each(visit)
    }));
    match walked {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(Fault::new("OpenStreetMap data", error, mend)),
        Err(_) => Err(Fault::new("OpenStreetMap data", "a block is damaged", mend)),
    }
}

/// The outlines of all buildings, in longitude and latitude [deg]. Three passes keep only what buildings need in memory.
/// What is left out is said to the notes.
pub fn read(bytes: &[u8], notes: &mut Notes) -> Result<Vec<Footprint>, Fault> {
    let bytes = &*pbf::readable(bytes)?;
    pbf::check_features(bytes)?;
    let buildings = buildings(bytes, notes)?;
    let needed: BTreeSet<i64> = buildings
        .iter()
        .flat_map(|b| b.outer.iter().chain(&b.inner))
        .copied()
        .collect();
    let mut ways: BTreeMap<i64, Vec<i64>> = BTreeMap::new();
    let mut nodes: BTreeMap<i64, DVec2> = BTreeMap::new();
    walk(bytes, |element| {
        if let Element::Way(way) = element
            && needed.contains(&way.id())
        {
            let ids: Vec<i64> = way.refs().collect();
            nodes.extend(ids.iter().map(|id| (*id, DVec2::NAN)));
            ways.insert(way.id(), ids);
        }
    })?;
    walk(bytes, |element| {
        let mut put = |id: i64, place: DVec2| {
            if let Some(found) = nodes.get_mut(&id) {
                *found = place;
            }
        };
        match element {
            Element::Node(node) => put(node.id(), DVec2::new(node.lon(), node.lat())),
            Element::DenseNode(node) => put(node.id(), DVec2::new(node.lon(), node.lat())),
            // Extracts with locations on ways need no nodes.
            Element::Way(way) => {
                for (id, place) in way.refs().zip(way.node_locations()) {
                    put(id, DVec2::new(place.lon(), place.lat()));
                }
            }
            Element::Relation(_) => {}
        }
    })?;
    let mut found = Vec::new();
    for building in buildings {
        assemble(building, &ways, &nodes, &mut found, notes);
    }
    Ok(found)
}

/// Ways and multipolygons that are buildings.
fn buildings(bytes: &[u8], notes: &mut Notes) -> Result<Vec<Building>, Fault> {
    let mut buildings = Vec::new();
    let points = "buildings that are points";
    walk(bytes, |element| match element {
        Element::Way(way) if way.tags().any(is_building) => buildings.push(Building {
            outer: vec![way.id()],
            inner: Vec::new(),
            known: tags(way.tags()),
            name: format!("way {}", way.id()),
        }),
        Element::Relation(relation) => {
            if !relation.tags().any(is_building) {
                return;
            }
            let mut known = tags(relation.tags());
            let name = format!("relation {}", relation.id());
            if known.get("type").and_then(Value::as_str) != Some("multipolygon") {
                // Its outline and parts are ways or multipolygons with tags of their own.
                return;
            }
            known.remove("type");
            let ways = relation
                .members()
                .filter(|m| m.member_type == RelMemberType::Way);
            let (inner, outer): (Vec<_>, Vec<_>) =
                ways.partition(|m| m.role().ok() == Some("inner"));
            let ids =
                |members: Vec<osmpbf::RelMember>| members.iter().map(|m| m.member_id).collect();
            buildings.push(Building {
                outer: ids(outer),
                inner: ids(inner),
                known,
                name,
            });
        }
        Element::Node(node) if node.tags().any(is_building) => {
            notes.leave_out(points, format!("node {}", node.id()));
        }
        Element::DenseNode(node) if node.tags().any(is_building) => {
            notes.leave_out(points, format!("node {}", node.id()));
        }
        _ => {}
    })?;
    Ok(buildings)
}

/// The outlines of a building, each with the holes inside it.
fn assemble(
    building: Building,
    ways: &BTreeMap<i64, Vec<i64>>,
    nodes: &BTreeMap<i64, DVec2>,
    found: &mut Vec<Footprint>,
    notes: &mut Notes,
) {
    let place = |ids: Vec<i64>| -> Vec<DVec2> {
        ids.iter().filter_map(|id| nodes.get(id).copied()).collect()
    };
    let whole = |ring: &Vec<DVec2>| ring.iter().all(|p| p.is_finite());
    let mut lost = [0_usize; 2];
    let mut rings = |ids: &[i64]| -> Vec<Vec<DVec2>> {
        let absent = ids.iter().filter(|id| !ways.contains_key(id)).count();
        let (closed, open) = join(ids, ways);
        let closed: Vec<_> = closed.into_iter().map(place).collect();
        let cut = closed.iter().filter(|ring| !whole(ring)).count();
        lost[0] += absent + cut;
        lost[1] += if absent == 0 { open } else { 0 };
        closed.into_iter().filter(whole).collect()
    };
    let inner = rings(&building.inner);
    let outer = rings(&building.outer);
    let kinds = [
        "buildings that the extract cuts off",
        "buildings whose outline does not close",
    ];
    if let Some((kind, _)) = kinds.iter().zip(lost).find(|(_, lost)| *lost > 0) {
        notes.leave_out(kind, &building.name);
    } else if outer.is_empty() {
        notes.leave_out("buildings without an outline", &building.name);
    }
    for outline in outer {
        let holes = inner
            .iter()
            .filter(|hole| {
                hole.first()
                    .is_some_and(|first| polygon::encloses(&outline, *first))
            })
            .cloned();
        let rings = std::iter::once(outline.clone()).chain(holes).collect();
        found.push(Footprint {
            rings,
            known: building.known.clone(),
            name: building.name.clone(),
        });
    }
}

/// Rings of nodes that ways close, end to end, and how many ways or chains of them close none.
fn join(ids: &[i64], ways: &BTreeMap<i64, Vec<i64>>) -> (Vec<Vec<i64>>, usize) {
    let mut left: Vec<Vec<i64>> = ids
        .iter()
        .filter_map(|id| ways.get(id))
        .filter(|way| way.len() >= 2)
        .cloned()
        .collect();
    let mut found = Vec::new();
    let mut open = 0;
    while let Some(mut ring) = left.pop() {
        while ring.first() != ring.last() {
            let end = ring.last().copied();
            let next = left
                .iter()
                .position(|way| way.first().copied() == end || way.last().copied() == end);
            let Some(next) = next else { break };
            let mut way = left.swap_remove(next);
            if way.first().copied() != end {
                way.reverse();
            }
            ring.extend(way.into_iter().skip(1));
        }
        if ring.first() == ring.last() {
            ring.pop();
            found.push(ring);
        } else {
            open += 1;
        }
    }
    (found, open)
}
