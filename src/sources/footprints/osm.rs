//! Buildings of an OpenStreetMap extract (`.osm.pbf`), through `osmpbf`.

use super::outline::Footprint;
use crate::models::maths::polygon;
use crate::sources::error::Fault;
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
}

/// Whether tags are those of a building or a part of one.
fn is_building(known: &Map<String, Value>) -> bool {
    let yes = |key: &str| {
        known
            .get(key)
            .and_then(Value::as_str)
            .is_some_and(|value| value != "no")
    };
    yes("building") || yes("building:part")
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
pub fn read(bytes: &[u8]) -> Result<Vec<Footprint>, Fault> {
    let mut buildings = Vec::new();
    walk(bytes, |element| match element {
        Element::Way(way) => {
            let known = tags(way.tags());
            if is_building(&known) {
                buildings.push(Building {
                    outer: vec![way.id()],
                    inner: Vec::new(),
                    known,
                });
            }
        }
        Element::Relation(relation) => {
            let mut known = tags(relation.tags());
            let multipolygon = known.get("type").and_then(Value::as_str) == Some("multipolygon");
            if multipolygon && is_building(&known) {
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
                });
            }
        }
        _ => {}
    })?;
    let needed: BTreeSet<i64> = buildings
        .iter()
        .flat_map(|b| b.outer.iter().chain(&b.inner))
        .copied()
        .collect();
    let mut ways: BTreeMap<i64, Vec<i64>> = BTreeMap::new();
    walk(bytes, |element| {
        if let Element::Way(way) = element
            && needed.contains(&way.id())
        {
            ways.insert(way.id(), way.refs().collect());
        }
    })?;
    let mut nodes: BTreeMap<i64, DVec2> = ways
        .values()
        .flatten()
        .map(|id| (*id, DVec2::NAN))
        .collect();
    walk(bytes, |element| {
        let (id, place) = match element {
            Element::Node(node) => (node.id(), DVec2::new(node.lon(), node.lat())),
            Element::DenseNode(node) => (node.id(), DVec2::new(node.lon(), node.lat())),
            _ => return,
        };
        if let Some(found) = nodes.get_mut(&id) {
            *found = place;
        }
    })?;
    let mut found = Vec::new();
    for building in buildings {
        let ring = |ids: Vec<i64>| -> Vec<DVec2> {
            ids.iter().filter_map(|id| nodes.get(id).copied()).collect()
        };
        let whole = |ring: &Vec<DVec2>| ring.len() >= 3 && ring.iter().all(|p| p.is_finite());
        let rings = |ids: &[i64]| {
            join(ids, &ways)
                .into_iter()
                .map(ring)
                .filter(whole)
                .collect::<Vec<_>>()
        };
        let inner = rings(&building.inner);
        for outline in rings(&building.outer) {
            let holes = inner
                .iter()
                .filter(|hole| polygon::encloses(&outline, hole[0]))
                .cloned();
            let rings = std::iter::once(outline.clone()).chain(holes).collect();
            found.push(Footprint {
                rings,
                known: building.known.clone(),
            });
        }
    }
    Ok(found)
}

/// Rings of nodes that ways close, end to end; ways that close none are left out (an extract cuts them off).
fn join(ids: &[i64], ways: &BTreeMap<i64, Vec<i64>>) -> Vec<Vec<i64>> {
    let mut left: Vec<Vec<i64>> = ids
        .iter()
        .filter_map(|id| ways.get(id))
        .filter(|way| way.len() >= 2)
        .cloned()
        .collect();
    let mut found = Vec::new();
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
        }
    }
    found
}
