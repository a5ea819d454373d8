//! The objects of the scene: their names and numbers, and what cameras look for.

use crate::models::ground::city::Met;
use crate::simulation::{Seen, UavView, View};
use std::collections::{BTreeMap, BTreeSet};

/// Names of what is not told apart.
const GROUND: &str = "Ground";
const TREES: &str = "Trees";
const STRUCTURES: &str = "Structures";
/// What the names of buildings begin with, before their number.
const BUILDING: &str = "Building_";

/// Numbers in a segmentation until others are set; the sky is 0. What flies has those from [`FLYING`] on, by turns.
const GROUND_ID: u8 = 1;
const TREES_ID: u8 = 2;
const STRUCTURES_ID: u8 = 3;
const BUILDINGS_ID: u8 = 4;
const FLYING: u8 = 10;

/// What is looked for within this distance of a camera until another is set \[m\]: as in AirSim.
const RADIUS_M: f64 = 200.0;

/// What a camera looks for.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Filter {
    pub patterns: BTreeSet<String>,
    pub radius_m: f64,
}

impl Default for Filter {
    fn default() -> Self {
        Self {
            patterns: BTreeSet::new(),
            radius_m: RADIUS_M,
        }
    }
}

/// What clients have set of the scene's objects.
#[derive(Debug, Default)]
pub(super) struct Objects {
    pub ids: BTreeMap<String, u8>,
    /// Filters by the camera's number and the kind of picture.
    pub filters: BTreeMap<(usize, u64), Filter>,
}

/// Numbers of objects in a segmentation.
pub(super) struct Ids {
    ground: u8,
    trees: u8,
    structures: u8,
    buildings: Vec<u8>,
    flying: Vec<u8>,
}

impl Ids {
    /// The number of what is seen.
    pub(super) fn of(&self, seen: Seen) -> u8 {
        match seen {
            Seen::Sky => 0,
            Seen::City(Met::Ground) => self.ground,
            Seen::City(Met::Tree) => self.trees,
            Seen::City(Met::Solid(_)) => self.structures,
            Seen::City(Met::Building(index)) => {
                self.buildings.get(index).copied().unwrap_or(BUILDINGS_ID)
            }
            Seen::Flying(index) => self.flying.get(index).copied().unwrap_or(FLYING),
        }
    }
}

/// The number of what flies, before another is set.
fn flying_id(index: usize) -> u8 {
    let numbers = usize::from(u8::MAX - FLYING) + 1;
    FLYING + (index % numbers) as u8
}

impl Objects {
    /// The number of an object of the scene.
    pub(super) fn id_of(&self, view: View, name: &str) -> Option<u8> {
        let set = self.ids.get(name).copied();
        let own = match name {
            GROUND => Some(GROUND_ID),
            TREES => Some(TREES_ID),
            STRUCTURES => Some(STRUCTURES_ID),
            _ => building(view, name).map(|_| BUILDINGS_ID),
        };
        let flying = || flying(view, name).map(|uav| flying_id(uav.index()));
        let own = own.or_else(flying);
        own.map(|own| set.unwrap_or(own))
    }

    /// The numbers of all objects.
    pub(super) fn ids(&self, view: View) -> Ids {
        let set = |name: &str, own: u8| self.ids.get(name).copied().unwrap_or(own);
        let buildings = 0..view.air().city().buildings.len();
        Ids {
            ground: set(GROUND, GROUND_ID),
            trees: set(TREES, TREES_ID),
            structures: set(STRUCTURES, STRUCTURES_ID),
            buildings: buildings
                .map(|index| set(&format!("{BUILDING}{index}"), BUILDINGS_ID))
                .collect(),
            flying: (view.uavs())
                .map(|uav| set(uav.name(), flying_id(uav.index())))
                .collect(),
        }
    }
}

/// What flies under a name.
pub(super) fn flying<'a>(view: View<'a>, name: &str) -> Option<UavView<'a>> {
    view.uavs().find(|uav| uav.name() == name)
}

/// The number of the building of a name.
pub(super) fn building(view: View, name: &str) -> Option<usize> {
    let index = name.strip_prefix(BUILDING)?.parse().ok()?;
    (index < view.air().city().buildings.len()).then_some(index)
}

/// Names of all objects.
pub(super) fn all(view: View) -> Vec<String> {
    let flying = view.uavs().map(|uav| uav.name().to_owned());
    let kinds = [GROUND, TREES, STRUCTURES].map(String::from);
    let buildings = 0..view.air().city().buildings.len();
    let buildings = buildings.map(|index| format!("{BUILDING}{index}"));
    flying.chain(kinds).chain(buildings).collect()
}
