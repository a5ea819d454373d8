//! UAVs and distractors: who they are, how they move, what has become of them.

use crate::models::air::wind::DrydenGust;
use crate::models::bodies::UavMesh;
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::fall::Fall;
use crate::models::flight::guided::Guided;
use crate::models::flight::multirotor::{Airframe, MultirotorState};
use crate::models::flight::navigation::Navigation;
use crate::models::flight::swarm::{Behaviour, Steering};
use crate::models::flight::trajectory::CompiledTrajectory;
use crate::models::laser::target::{Effect, Hull, Parts, Patch};
use crate::models::maths::rng::Stream;
use crate::models::tracking::recognition::TrackClass;
use bevy::prelude::*;
use glam::DVec3;
use std::sync::{Arc, OnceLock};

/// Identity of a UAV or distractor.
#[derive(Component, Clone, Debug)]
pub struct Uav {
    /// Index in the scenario, distractors after all UAVs; the key of its random streams.
    pub index: usize,
    /// Name from the scenario.
    pub name: String,
    /// Length, width and height [m].
    pub size_m: [f64; 3],
}

/// Marks what is no UAV but flies where one might, and says how it flies. It has no [`Guidance`] and
/// no [`HeatedSkin`]: it is never neutralised, and a run does not wait for it.
#[derive(Component, Clone, Debug)]
pub struct Distractor {
    /// What it is: bird, aircraft, balloon or leaf.
    pub kind: DistractorKind,
    /// Its path: over the ground for birds and aeroplanes, through the air for balloons and leaves.
    pub plan: CompiledTrajectory,
    /// Phase of the wingbeat at time 0 [rad].
    pub phase_rad: f64,
}

impl Distractor {
    /// What a thing is: a UAV, unless it is one of these.
    pub fn class_of(distractor: Option<&Self>) -> TrackClass {
        distractor.map_or(TrackClass::Uav, |other| other.kind.class().into())
    }
}

/// Motion, the truth in f64.
#[derive(Component, Clone, Debug)]
pub struct Flight {
    /// Position, attitude, rates and rotors; a bird's wings are its rotors.
    pub state: MultirotorState,
    /// The point to aim at [m, body]: the middle of the part that the scenario names.
    pub aim_body_m: DVec3,
}

impl Flight {
    /// Where the aim point is [m].
    pub fn aim_enu_m(&self) -> DVec3 {
        self.state.r_enu_m + self.state.q_enu_body * self.aim_body_m
    }
}

/// Where a UAV wants to be at any time.
#[derive(Clone, Debug)]
pub enum Plan {
    /// On a path that is set before.
    Path(CompiledTrajectory),
    /// Where it steers as a member of a swarm.
    Swarm(Box<Steering>),
    /// Where an order says.
    Guided(Box<Guided>),
}

/// The swarms of a run, in the order of the scenario.
#[derive(Resource, Clone, Debug, Default)]
pub struct Swarms(pub Vec<Behaviour>);

/// What flies by a rotor model: its flight plan and airframe.
#[derive(Component, Clone, Debug)]
pub struct Guidance {
    /// Where it wants to be.
    pub plan: Plan,
    /// Constants of the airframe.
    pub airframe: Airframe,
    /// Take-off mass [kg].
    pub mass_kg: f64,
    /// How well it knows its place.
    pub navigation: Navigation,
}

/// The air the UAV meets.
#[derive(Component, Clone, Debug)]
pub struct Air {
    /// Gust generator.
    pub gusts: DrydenGust,
    /// Random stream of the gusts; `None` where neighbours share them.
    pub rng: Option<Stream>,
    /// Mean wind plus gust at the UAV [m/s].
    pub wind_enu_mps: DVec3,
}

/// What lasers have done to a UAV.
#[derive(Component, Clone, Debug)]
pub struct HeatedSkin {
    /// Where it has what, and of what that is made.
    pub parts: Arc<Parts>,
    /// Temperature at which the part aimed at fails [K].
    pub limit_k: f64,
    /// Length of a wall along the flow [m], for its cooling.
    pub length_m: f64,
    /// Where beams have fallen, while it is warm or marked.
    pub patches: Vec<Patch>,
    /// The hottest of what would fail, the wall that bears or what lies behind it [K].
    pub temperature_k: f64,
    /// The hottest place of all [K].
    pub face_k: f64,
    /// Area that is burnt through [m^2].
    pub hole_m2: f64,
    /// Parts lost, in the order of their loss: what that does, and the part's name.
    pub lost: Vec<(Effect, &'static str)>,
    /// Mean irradiance over the bucket about the aim point in this tick [W/m^2].
    pub irradiance_wpm2: f64,
}

impl HeatedSkin {
    /// Untouched, at the temperature of the air [K].
    pub fn new(parts: Parts, limit_k: f64, length_m: f64, air_k: f64) -> Self {
        Self {
            parts: Arc::new(parts),
            limit_k,
            length_m,
            patches: Vec::new(),
            temperature_k: air_k,
            face_k: air_k,
            hole_m2: 0.0,
            lost: Vec::new(),
            irradiance_wpm2: 0.0,
        }
    }

    /// Names of the parts lost, in the order of their loss.
    pub fn lost_parts(&self) -> Vec<String> {
        let parts = self.lost.iter().map(|(_, part)| (*part).to_owned());
        parts.collect()
    }
}

/// What has become of a UAV.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum UavStatus {
    /// Flies its plan.
    Flying,
    /// The laser has burnt it through; it falls.
    Falling,
    /// It has met another UAV in the air, or the city; it falls.
    Struck,
    /// It lies on the city.
    Down,
    /// It lies on the city after it was struck.
    Crashed,
    /// It stands on its pad, before it takes off or after it has landed.
    Landed,
}

impl UavStatus {
    /// The status as recordings and reports name it.
    pub fn name(self) -> &'static str {
        match self {
            UavStatus::Flying => "flying",
            UavStatus::Falling => "falling",
            UavStatus::Struck => "struck",
            UavStatus::Down => "down",
            UavStatus::Crashed => "crashed",
            UavStatus::Landed => "landed",
        }
    }

    /// The status of that name.
    pub fn named(name: &str) -> Option<Self> {
        let all = [
            UavStatus::Flying,
            UavStatus::Falling,
            UavStatus::Struck,
            UavStatus::Down,
            UavStatus::Crashed,
            UavStatus::Landed,
        ];
        all.into_iter().find(|status| status.name() == name)
    }

    /// Whether it lies or stands on the city.
    pub fn grounded(self) -> bool {
        matches!(
            self,
            UavStatus::Down | UavStatus::Crashed | UavStatus::Landed
        )
    }

    /// Whether the laser has done its work.
    pub fn neutralised(self) -> bool {
        matches!(self, UavStatus::Falling | UavStatus::Down)
    }
}

/// The shape of a UAV or distractor, for truth boxes and silhouettes.
#[derive(Component, Clone)]
pub struct UavShape {
    /// Airframe and rotors, shared with the renderer.
    pub mesh: Arc<UavMesh>,
    /// Points whose projections' box holds that of the airframe with its rotor discs [m, body].
    pub outline_body_m: Vec<DVec3>,
    /// Distance of the farthest of them from the origin [m].
    pub radius_m: f64,
    /// The airframe for rays, once a beam has come near.
    hull: OnceLock<Option<Hull>>,
}

impl UavShape {
    /// Works outline and radius out from a mesh.
    pub fn new(mesh: Arc<UavMesh>) -> Self {
        let outline_body_m = mesh.outline_body_m();
        let radius_m = outline_body_m
            .iter()
            .map(|p| p.length())
            .fold(0.0, f64::max);
        Self {
            mesh,
            outline_body_m,
            radius_m,
            hull: OnceLock::new(),
        }
    }

    /// The airframe without rotors, for rays; `None` of one without triangles.
    pub fn hull(&self) -> Option<&Hull> {
        let hull = self.hull.get_or_init(|| Hull::new(&self.mesh.body));
        hull.as_ref()
    }
}

/// What a UAV is once it falls, until it is down. Every UAV has one from the start: what comes to
/// it changes neither its archetype nor the order in which systems meet it.
#[derive(Component, Clone, Default)]
pub struct Wreck(pub Option<Box<WreckFall>>);

/// A fall over one patch of city.
#[derive(Clone)]
pub struct WreckFall {
    /// The box that falls.
    pub fall: Fall,
    /// Where the fall began [m].
    pub origin_enu_m: DVec3,
    /// Half the side of the patch [m].
    pub half_m: f64,
    /// How long it has lain still [s].
    pub still_s: f64,
}
