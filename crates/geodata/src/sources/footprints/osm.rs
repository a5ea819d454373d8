//! Buildings of an OpenStreetMap extract (`.osm.pbf`), through `osmpbf`.

use super::outline::{Footprint, states_height};
use super::pbf;
use super::rings::{around, distinct, join};
use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use glam::DVec2;
use osmpbf::{Element, ElementReader, RelMemberType};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A building: its outer and inner ways.
struct Building {
    /// Whether it is a multipolygon, not a way.
    relation: bool,
    outer: Vec<i64>,
    inner: Vec<i64>,
    known: Map<String, Value>,
    name: String,
}

/// Values of `building` for what does not stand.
const ABSENT: [&str; 7] = [
    "",
    "proposed",
    "planned",
    "demolished",
    "razed",
    "removed",
    "destroyed",
];

/// Whether a tag makes an element a building or a part of one.
fn is_building((key, value): (&str, &str)) -> bool {
    matches!(key, "building" | "building:part") && value != "no"
}

/// Whether tags say that the building does not stand; then it is said to the notes.
fn is_absent(known: &Map<String, Value>, name: &str, notes: &mut Notes) -> bool {
    let value = known.get("building").or(known.get("building:part"));
    let value = value.and_then(Value::as_str).unwrap_or_default().trim();
    let absent = ABSENT.contains(&value);
    if absent {
        notes.leave_out(
            "buildings that do not stand",
            format!("{name}, building={value}"),
        );
    }
    absent
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
            // Some programs write 214.7483647° for a place that they do not know.
            let somewhere = place.x.abs() <= 180.0 && place.y.abs() <= 90.0;
            if let Some(found) = nodes.get_mut(&id).filter(|_| somewhere) {
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
    for building in each_once(buildings, notes) {
        assemble(building, &ways, &nodes, &mut found, notes);
    }
    Ok(found)
}

/// Buildings without those that are given twice: as a way with tags of its own, and as the multipolygon that has this way for its
/// outline. The multipolygon has the holes, the way what it lacks of tags. Ways that are several houses, each with a height, stay beside
/// a multipolygon that states none.
fn each_once(buildings: Vec<Building>, notes: &mut Notes) -> Vec<Building> {
    let whole = |building: &Building| !building.known.contains_key("building:part");
    let numbered = buildings.into_iter().enumerate();
    let (mut relations, ways): (Vec<_>, Vec<_>) = numbered.partition(|(_, b)| b.relation);
    let mut own: BTreeMap<i64, (usize, Building)> = BTreeMap::new();
    let mut others = Vec::new();
    for (number, way) in ways {
        match way.outer.first().filter(|_| whole(&way)) {
            Some(id) => drop(own.insert(*id, (number, way))),
            None => others.push((number, way)),
        }
    }
    relations.retain_mut(|(_, relation)| {
        if !whole(relation) {
            return true;
        }
        let houses = relation.outer.iter().filter_map(|id| own.get(id));
        let each_is_high = houses.clone().all(|(_, house)| states_height(&house.known));
        if houses.count() > 1 && each_is_high && !states_height(&relation.known) {
            notes.leave_out("multipolygons around houses of their own", &relation.name);
            return false;
        }
        for id in &relation.outer {
            let Some((_, way)) = own.remove(id) else {
                continue;
            };
            notes.leave_out("outlines that a multipolygon repeats", &way.name);
            for (key, value) in way.known {
                relation.known.entry(key).or_insert(value);
            }
        }
        true
    });
    let mut all: Vec<(usize, Building)> =
        own.into_values().chain(others).chain(relations).collect();
    all.sort_by_key(|(number, _)| *number);
    all.into_iter().map(|(_, building)| building).collect()
}

/// Ways and multipolygons that are buildings.
fn buildings(bytes: &[u8], notes: &mut Notes) -> Result<Vec<Building>, Fault> {
    let mut buildings = Vec::new();
    let points = "buildings that are points";
    walk(bytes, |element| match element {
        Element::Way(way) if way.tags().any(is_building) => {
            let (known, name) = (tags(way.tags()), format!("way {}", way.id()));
            if !is_absent(&known, &name, notes) {
                buildings.push(Building {
                    relation: false,
                    outer: vec![way.id()],
                    inner: Vec::new(),
                    known,
                    name,
                });
            }
        }
        Element::Relation(relation) => {
            if !relation.tags().any(is_building) {
                return;
            }
            let mut known = tags(relation.tags());
            let name = format!("relation {}", relation.id());
            let kind = known.get("type").and_then(Value::as_str).unwrap_or("");
            match kind.to_ascii_lowercase().as_str() {
                "multipolygon" | "boundary" | "" => {}
                // Its outline and parts are ways or multipolygons with tags of their own.
                "building" => return,
                _ => {
                    let place = format!("{name}, type={kind}");
                    notes.leave_out("relations of buildings that are no multipolygons", place);
                    return;
                }
            }
            known.remove("type");
            if is_absent(&known, &name, notes) {
                return;
            }
            let ways = relation
                .members()
                .filter(|m| m.member_type == RelMemberType::Way);
            let (inner, outer): (Vec<_>, Vec<_>) = ways.partition(|m| {
                m.role()
                    .is_ok_and(|role| role.eq_ignore_ascii_case("inner"))
            });
            let ids =
                |members: Vec<osmpbf::RelMember>| members.iter().map(|m| m.member_id).collect();
            buildings.push(Building {
                relation: true,
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

/// The outlines of a building, each with the holes inside it: what lies in an odd number of other rings is a hole, whatever role its
/// ways are given (as the wiki of OpenStreetMap's multipolygons has it), and roles that say otherwise are noted.
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
    let all: Vec<i64> = building
        .outer
        .iter()
        .chain(&building.inner)
        .copied()
        .collect();
    let absent = all.iter().filter(|id| !ways.contains_key(id)).count();
    let [outer, inner] = [&building.outer, &building.inner].map(|ids| join(ids, ways));
    let as_stated = outer.1 + inner.1 == 0;
    // Ways of both roles may close a ring that those of one do not.
    let (rings, open): (Vec<(Vec<i64>, bool)>, usize) = match as_stated {
        true => {
            let outer = outer.0.into_iter().map(|ring| (ring, false));
            let inner = inner.0.into_iter().map(|ring| (ring, true));
            (outer.chain(inner).collect(), 0)
        }
        false => {
            let (rings, open) = join(&all, ways);
            (rings.into_iter().map(|ring| (ring, false)).collect(), open)
        }
    };
    let places = rings.into_iter().map(|(ring, inner)| (place(ring), inner));
    let (rings, lost): (Vec<_>, Vec<_>) = places.partition(|(ring, _)| whole(ring));
    let (rings, inner): (Vec<Vec<DVec2>>, Vec<bool>) =
        distinct(rings.into_iter()).into_iter().unzip();
    let cut = lost.len();
    if rings.is_empty() {
        let kind = match absent + cut {
            0 if open > 0 => "buildings whose outline does not close",
            0 => "buildings without an outline",
            _ => "buildings that the extract cuts off",
        };
        notes.leave_out(kind, &building.name);
        return;
    }
    if absent + cut > 0 {
        notes.leave_out(
            "parts of buildings that the extract cuts off",
            &building.name,
        );
    } else if open > 0 {
        notes.leave_out(
            "parts of buildings whose outline does not close",
            &building.name,
        );
    }
    let around = around(&rings, &inner);
    let holes = around.iter().map(|around| around.len() % 2 == 1);
    if as_stated && !holes.eq(inner) {
        let what = "roles of its ways that contradict how they lie: the latter counts";
        let mend = "give the role inner to the ways of holes, and outer to the others";
        notes.assume(&building.name, what, mend);
    }
    for (k, outline) in rings
        .iter()
        .enumerate()
        .filter(|(k, _)| around[*k].len().is_multiple_of(2))
    {
        let inside =
            |hole: &usize| around[*hole].len() == around[k].len() + 1 && around[*hole].contains(&k);
        let holes = (0..rings.len())
            .filter(inside)
            .map(|hole| rings[hole].clone());
        let rings = std::iter::once(outline.clone()).chain(holes).collect();
        found.push(Footprint {
            rings,
            known: building.known.clone(),
            name: building.name.clone(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::maths::polygon;

    /// Areas of what ways make [squares of the lattice], each with its holes off, and what is said.
    fn areas(ways: &[&[i64]], outer: &[i64], inner: &[i64]) -> (Vec<f64>, String) {
        let ways: BTreeMap<i64, Vec<i64>> =
            (1..).zip(ways.iter().map(|way| way.to_vec())).collect();
        // Node xy lies at (x, y); node 99 was cut off.
        let nodes = (0..99).map(|id| (id, DVec2::new((id / 10) as f64, (id % 10) as f64)));
        let nodes = nodes.chain([(99, DVec2::NAN)]).collect();
        let building = Building {
            relation: true,
            outer: outer.to_vec(),
            inner: inner.to_vec(),
            known: Map::new(),
            name: "relation 1".into(),
        };
        let (mut found, mut notes) = (Vec::new(), Notes::default());
        assemble(building, &ways, &nodes, &mut found, &mut notes);
        let area = |ring: &Vec<DVec2>| polygon::area_m2(ring).abs();
        let mut areas: Vec<f64> = (found.iter())
            .map(|f| area(&f.rings[0]) - f.rings[1..].iter().map(area).sum::<f64>())
            .collect();
        areas.sort_by(f64::total_cmp);
        let lines = notes.warnings(std::path::Path::new("a.osm.pbf"));
        (areas, lines.iter().map(ToString::to_string).collect())
    }

    const BIG: &[i64] = &[0, 80, 88, 8, 0];
    const HOLE: &[i64] = &[11, 61, 66, 16, 11];
    const ISLAND: &[i64] = &[22, 42, 44, 24, 22];

    #[test]
    fn a_hole_is_a_hole_whatever_its_role() {
        for (outer, inner, said) in [
            (&[1, 2][..], &[][..], true),
            (&[2], &[1], true),
            (&[1], &[2], false),
            (&[], &[1, 2], true),
        ] {
            let (found, told) = areas(&[BIG, HOLE], outer, inner);
            assert_eq!(found, [64.0 - 25.0], "{outer:?} {inner:?}");
            assert_eq!(
                told.contains("contradict"),
                said,
                "{outer:?} {inner:?}: {told}"
            );
        }
        // Holes that share corners with the outline, and an edge.
        for hole in [&[0, 52, 25, 0][..], &[80, 88, 45, 80], &[8, 0, 44, 8]] {
            let (found, told) = areas(&[BIG, hole], &[1], &[2]);
            assert!(
                found.len() == 1 && found[0] < 64.0 && told.is_empty(),
                "{hole:?}: {found:?} {told}"
            );
        }
        let (found, told) = areas(&[BIG, HOLE, ISLAND], &[1, 3], &[2]);
        assert_eq!((found, told.as_str()), (vec![4.0, 39.0], ""));
    }

    #[test]
    fn rings_of_many_ways_close_or_are_counted() {
        let parts: &[&[i64]] = &[&[0, 80, 88], &[0, 8, 88]];
        assert_eq!(areas(parts, &[1, 2], &[]).0, [64.0]);
        assert_eq!(areas(parts, &[1], &[2]).0, [64.0]);
        let (found, told) = areas(&[&[0, 80, 88]], &[1], &[]);
        assert!(
            found.is_empty() && told.contains("1 buildings whose outline does not close"),
            "{told}"
        );
        let (found, told) = areas(&[BIG], &[1, 7], &[]);
        assert!(
            found == [64.0] && told.contains("1 parts of buildings that the extract cuts off"),
            "{told}"
        );
        let (found, told) = areas(&[&[0, 80, 99, 0]], &[1], &[]);
        assert!(
            found.is_empty() && told.contains("1 buildings that the extract cuts off"),
            "{told}"
        );
    }

    #[test]
    fn what_is_given_twice_counts_once() {
        assert_eq!(areas(&[BIG, BIG], &[1, 2], &[]).0, [64.0]);
        assert_eq!(areas(&[BIG, HOLE, HOLE], &[1], &[2, 3]).0, [39.0]);
        assert_eq!(areas(&[BIG, HOLE], &[1, 2], &[2]).0, [39.0]);
        let building = |outer: &[i64], inner: &[i64], tags: &[(&str, &str)]| Building {
            relation: outer.len() + inner.len() > 1,
            outer: outer.to_vec(),
            inner: inner.to_vec(),
            known: super::tags(tags.iter().copied()),
            name: format!("{outer:?}"),
        };
        let kept = |buildings: Vec<Building>| {
            let mut notes = Notes::default();
            let kept = each_once(buildings, &mut notes);
            let height = |b: &Building| {
                b.known
                    .get("height")
                    .and_then(Value::as_str)
                    .map(String::from)
            };
            (
                kept.iter().map(height).collect::<Vec<_>>(),
                notes.count_left_out(),
            )
        };
        let (house, high) = (("building", "yes"), ("height", "30"));
        // The way has the height, the multipolygon the hole.
        let one = vec![
            building(&[1], &[], &[house, high]),
            building(&[1], &[2], &[house]),
        ];
        assert_eq!(kept(one), (vec![Some("30".into())], 1));
        // Two houses in a group of which no height is known.
        let two = vec![
            building(&[1], &[], &[house, high]),
            building(&[2], &[], &[house, ("height", "20")]),
            building(&[1, 2], &[], &[house]),
        ];
        assert_eq!(kept(two), (vec![Some("30".into()), Some("20".into())], 1));
        // Parts are no repetition.
        let part = vec![
            building(&[1], &[], &[house, high]),
            building(&[1], &[2], &[("building:part", "yes")]),
        ];
        assert_eq!(kept(part), (vec![Some("30".into()), None], 0));
    }
}
