//! An engagement watched tick by tick: truth beside what the station believes. Nothing is fed back.

use super::looks::Looks;
use super::verdict::{Believed, Cause, GivenUp, Glance, LATELY_S, LEAST_PX, Record, What, charge};
use crate::components::beam::BeamState;
use crate::components::capture::{ExposedFrame, SensorCamera, Tier, UavInFrame};
use crate::components::detect::{DetectionBatch, DetectionQueue, DetectorInUse};
use crate::components::engage::{Interlocks, Rules};
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, Uav, UavShape, UavStatus};
use crate::components::mount::{CameraView, Mount, Optics};
use crate::components::run::SimClock;
use crate::components::track::{Tracker, TrackerParams, TrackingState};
use crate::models::engage::interlock::{FAR_M, faces_sun};
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::kinematics::{az_el_to_los, boresight_chain, los_to_az_el};
use crate::models::optics::clutter::signal_to_clutter;
use crate::models::optics::tier::PerTier;
use crate::models::sensing::measured::Row;
use crate::models::tracking::held::on_sight;
use crate::models::tracking::table::Track;
use crate::report::run::{ContactBox, ContactFrame};
use crate::systems::capture::projected;
use bevy::prelude::*;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// Looks at the truth a second [Hz].
const LOOK_HZ: u32 = 60;
/// How often what is believed of each track is noted [Hz].
const BELIEF_HZ: u32 = 1;
/// The pictures of a cause show the instant at which it has lasted this long without a break [s].
const MOMENT_S: f64 = 0.25;
/// Pictures older than this show nothing of a moment [s].
const STALE_S: f64 = 2.0;
/// States that a record keeps from the start, and from the end.
const KEPT_STATES: usize = 30;

type Station = (
    Entity,
    &'static Mount,
    &'static Optics,
    &'static BeamState,
    &'static Tracker,
    &'static TrackerParams,
);
type Flying = (
    &'static Uav,
    &'static Flight,
    &'static UavShape,
    Option<&'static Distractor>,
    Option<&'static UavStatus>,
);

/// The watch over one run.
pub struct Watch {
    station: QueryState<Station>,
    flying: QueryState<Flying>,
    seen: Seen,
    looks: Option<Looks>,
}

/// What the watch has seen so far.
struct Seen {
    record: Record,
    cameras: PerTier<Option<(Entity, SensorCamera)>>,
    /// The last pictures whose detections have arrived.
    latest: PerTier<Option<DetectionBatch>>,
    /// Pictures of the first moment of each cause.
    moments: BTreeMap<Cause, Vec<ContactFrame>>,
    /// What time is being charged to, and since when [s].
    charged: Option<(Cause, f64)>,
    /// What the target was at the last look, and whether the UAV was shown.
    target: Option<What>,
    shown: bool,
    /// Identity of the last target.
    identity: Option<u32>,
    /// Changes of state that have been taken in.
    changes: usize,
    /// Whether the UAV was given up as none, and has not been the target since.
    rejected: bool,
    /// When a camera last had the UAV in view, and last found it [s].
    in_view_s: f64,
    found_s: f64,
    /// Looks at which the UAV was shown, and the sum of its sizes in the search camera [px].
    sizes: (u32, f64),
}

/// A tick, and what is looked at in it.
struct Now<'a> {
    world: &'a World,
    station: Entity,
    clock: SimClock,
    t_s: f64,
    tracker: &'a Tracker,
    candidate_hits: u32,
    r_station_enu_m: DVec3,
    optics: &'a Optics,
    firing: bool,
    /// All that flies; the UAV first.
    flying: Vec<Thing<'a>>,
}

/// What flies.
struct Thing<'a> {
    index: usize,
    flight: &'a Flight,
    shape: &'a UavShape,
    what: What,
    status: Option<UavStatus>,
    /// From the station [m].
    to_m: DVec3,
}

impl Watch {
    /// A watch over a run that is about to start, which also keeps what detector and recogniser say if that is wanted.
    pub fn new(world: &mut World, looks: bool) -> Self {
        let looks = looks.then(|| Looks::new(world));
        let mut cameras: PerTier<Option<(Entity, SensorCamera)>> = PerTier::default();
        for (entity, camera) in world.query::<(Entity, &SensorCamera)>().iter(world) {
            cameras[camera.tier].get_or_insert((entity, camera.clone()));
        }
        Self {
            looks,
            station: world.query(),
            flying: world.query(),
            seen: Seen {
                record: Record::default(),
                cameras,
                latest: PerTier::default(),
                moments: BTreeMap::new(),
                charged: None,
                target: None,
                shown: false,
                identity: None,
                changes: 0,
                rejected: false,
                in_view_s: f64::NEG_INFINITY,
                found_s: f64::NEG_INFINITY,
                sizes: (0, 0.0),
            },
        }
    }

    /// Takes in what a tick left; true once the UAV has come to its end.
    pub fn tick(&mut self, world: &World) -> bool {
        let now = Now::of(&mut self.station, &mut self.flying, world);
        now.is_some_and(|now| {
            if let Some(looks) = &mut self.looks {
                let on = |track: &Track| {
                    let los = track.filter.predicted(now.t_s).az_el_rad();
                    now.thing_on(az_el_to_los(los)).map(|thing| thing.index)
                };
                looks.tick(world, now.station, on);
            }
            self.seen.take_in(&now)
        })
    }

    /// What detector and recogniser said.
    pub fn rows(&mut self) -> Vec<Row> {
        let looks = self.looks.take();
        looks.map_or_else(Vec::new, |looks| looks.rows)
    }

    /// The record of the run, and the pictures of the cause that `which` finds in it: of its first moment, or
    /// of the end where time ran out.
    pub fn conclude(
        mut self,
        world: &World,
        which: impl FnOnce(&Record) -> Option<Cause>,
    ) -> (Record, Vec<ContactFrame>) {
        let now = Now::of(&mut self.station, &mut self.flying, world);
        let seen = &mut self.seen;
        if seen.sizes.0 > 0
            && let Some((_, search)) = &seen.cameras.search
            && let Some((_, precise)) = &seen.cameras.precise
        {
            let mean_px = seen.sizes.1 / f64::from(seen.sizes.0);
            let larger = precise.pinhole.focal_px / search.pinhole.focal_px;
            seen.record.size_px = Some([mean_px, larger * mean_px]);
        }
        let pictures = which(&seen.record).and_then(|cause| {
            let first = seen.moments.remove(&cause);
            let first = first.filter(|_| cause != Cause::OutOfTime);
            first.or_else(|| now.map(|now| seen.moment(&now, cause.name())))
        });
        (self.seen.record, pictures.unwrap_or_default())
    }
}

impl Seen {
    fn take_in(&mut self, now: &Now) -> bool {
        self.record.end_s = now.t_s;
        self.pictures(now);
        self.state_changes(now);
        if now.firing {
            self.fire(now);
        }
        if now.clock.due(LOOK_HZ) {
            self.look(now);
        }
        if now.clock.due(BELIEF_HZ) {
            self.record.beliefs.extend(now.beliefs());
        }
        match now.flying.first().and_then(|uav| uav.status) {
            Some(UavStatus::Falling | UavStatus::Down) => {
                self.record.neutralised_s = Some(now.t_s);
                true
            }
            Some(UavStatus::Struck | UavStatus::Crashed) => {
                self.record.crashed = true;
                true
            }
            _ => false,
        }
    }

    /// Keeps the pictures that have arrived, and whether the UAV was found in them.
    fn pictures(&mut self, now: &Now) {
        let queue = now.world.get::<DetectionQueue>(now.station);
        for batch in queue.iter().flat_map(|queue| &queue.arrived) {
            let tier = batch.frame.tier;
            let uav = batch.frame.truth.iter().find(|seen| !seen.distractor);
            if let Some(uav) = uav.filter(|uav| uav.clear && batch.look.holds(uav.aim_px)) {
                let t_s = now.clock.at_s(batch.frame.tick);
                let mut detections = batch.detections.iter();
                let found = detections.any(|detection| detection.lies_on(uav.box_px));
                self.in_view_s = self.in_view_s.max(t_s);
                if found {
                    self.found_s = self.found_s.max(t_s);
                }
                let acquired = self.record.acquired_s.is_some();
                let looks = &mut self.record.looks[tier as usize];
                looks.frames += 1;
                looks.found += u32::from(found);
                if !acquired && let Some(ratio) = clutter_ratio(&batch.frame, uav) {
                    looks.stands_out(ratio);
                }
            }
            self.latest[tier] = Some(batch.clone());
        }
    }

    /// Takes in what the tracker decided in this tick.
    fn state_changes(&mut self, now: &Now) {
        let tracker = now.tracker;
        for (number, change) in tracker.changes.iter().enumerate().skip(self.changes) {
            let before = number
                .checked_sub(1)
                .map(|before| tracker.changes[before].to);
            let t_s = now.clock.at_s(change.tick);
            let entry = (t_s, change.to.name().to_owned(), change.reason.clone());
            let states = &mut self.record.states;
            if states.len() >= 2 * KEPT_STATES {
                states.remove(KEPT_STATES);
            }
            states.push(entry);
            let on_uav = self.target == Some(What::Uav);
            if change.to == TrackingState::Search && on_uav && self.shown {
                let left = self.identity.and_then(|id| tracker.table.get(id));
                let rejected =
                    left.is_some_and(|track| track.is_barred(t_s) || track.log_odds() < 0.0);
                self.rejected = rejected;
                self.record.given_up.push(GivenUp {
                    t_s,
                    reason: change.reason.clone(),
                    rejected,
                });
            }
            if change.to.acquired()
                && !before.is_some_and(TrackingState::acquired)
                && let Some(what) = now.target().filter(|what| *what != What::Uav)
            {
                self.record.acquired_else.push((t_s, what.name().into()));
            }
        }
        self.changes = tracker.changes.len();
        if tracker.target.is_some() && tracker.target != self.identity {
            self.record.target_changes += u32::from(self.identity.is_some());
            self.identity = tracker.target;
        }
        let count = tracker.table.tracks.len();
        self.record.tracks = self.record.tracks.max(count);
    }

    /// Notes what is fired at: what is on the laser's axis.
    fn fire(&mut self, now: &Now) {
        let what = now.on(now.optics.laser.q_enu_cam * DVec3::Z);
        let first = !self.record.fired_s.contains_key(what.name());
        *self.record.fired_s.entry(what.name().into()).or_default() += now.clock.dt_s();
        if what != What::Uav && first {
            let pictures = self.moment(now, "fires at something else");
            self.moments.insert(Cause::WrongObject, pictures);
        }
    }

    /// Compares truth and belief.
    fn look(&mut self, now: &Now) {
        let dt_s = 1.0 / f64::from(LOOK_HZ);
        let Some(uav) = now.flying.first().filter(|uav| uav.what == What::Uav) else {
            return;
        };
        let clear = now.is_clear(uav);
        let size_px = self.size_px(now, uav);
        let shown = clear && size_px >= LEAST_PX;
        let target = now.target();
        self.shown = shown;
        self.target.clone_from(&target);
        let held = now.tracker.state.acquired();
        let held_uav = held && target == Some(What::Uav);
        let record = &mut self.record;
        if target == Some(What::Uav) {
            self.rejected = false;
        }
        if held_uav {
            record.acquired_s.get_or_insert(now.t_s);
            if now.tracker.state.holds(Tier::Precise) {
                record.precise_s.get_or_insert(now.t_s);
            }
        }
        if shown {
            record.shown_s += dt_s;
            self.sizes = (self.sizes.0 + 1, self.sizes.1 + size_px);
            if self
                .cameras
                .search
                .as_ref()
                .is_some_and(|c| now.in_field(c, uav))
            {
                record.visible_s += dt_s;
                record.visible_from_s.get_or_insert(now.t_s);
            }
            if now.open(uav) {
                record.open_s += dt_s;
            }
            if record.acquired_s.is_some() {
                record.after_s += dt_s;
                if held && let Some(what) = &target {
                    *record.held_s.entry(what.name().into()).or_default() += dt_s;
                }
            }
            let apart_deg = now.nearest_deg(uav);
            record.nearest_deg = [record.nearest_deg, apart_deg]
                .into_iter()
                .flatten()
                .reduce(f64::min);
        }
        self.charge(now, shown, target, dt_s);
    }

    /// Charges the time of a look to a cause.
    fn charge(&mut self, now: &Now, shown: bool, target: Option<What>, dt_s: f64) {
        let interlocks = (now.world.get::<Interlocks>(now.station))
            .map_or(&[][..], |interlocks| &interlocks.reasons);
        let on_uav = target == Some(What::Uav);
        if on_uav && now.tracker.state == TrackingState::Engage && !now.firing {
            for reason in interlocks {
                let reason = (*reason).to_owned();
                *self.record.interlocks_s.entry(reason).or_default() += dt_s;
            }
        }
        let glance = Glance {
            shown,
            met: self.record.visible_from_s.is_some(),
            state: now.tracker.state,
            target,
            found: self.found_s >= self.in_view_s - LATELY_S,
            acquired: self.record.acquired_s.is_some(),
            rejected: self.rejected,
            firing: now.firing,
            interlocked: !interlocks.is_empty(),
        };
        let cause = charge(&glance);
        if let Some(cause) = cause {
            *self.record.charges_s.entry(cause).or_default() += dt_s;
        }
        match (cause, self.charged) {
            (Some(cause), Some((same, since_s))) if cause == same => {
                let lasts = now.t_s - since_s >= MOMENT_S;
                if lasts && !self.moments.contains_key(&cause) {
                    let pictures = self.moment(now, cause.name());
                    self.moments.insert(cause, pictures);
                }
            }
            (cause, _) => self.charged = cause.map(|cause| (cause, now.t_s)),
        }
    }

    /// The longer side of the UAV in the search camera, were it in the middle of the picture [px].
    fn size_px(&self, now: &Now, uav: &Thing) -> f64 {
        let Some((_, search)) = &self.cameras.search else {
            return 0.0;
        };
        let [az, el] = los_to_az_el(uav.to_m).to_array();
        let zero = DVec3::ZERO;
        let pose = boresight_chain(now.r_station_enu_m, zero, az, el, DVec2::ZERO, zero);
        projected(&search.pinhole, &pose, uav.flight, uav.shape).map_or(0.0, |seen| {
            let [x0, y0, x1, y1] = seen.box_px;
            (x1 - x0).max(y1 - y0)
        })
    }

    /// The last picture of each camera with what was found and what is true in it.
    fn moment(&self, now: &Now, why: &str) -> Vec<ContactFrame> {
        let detector = now.world.resource::<DetectorInUse>();
        let fresh = Tier::ALL
            .iter()
            .filter_map(|tier| self.latest[*tier].as_ref())
            .filter_map(|batch| {
                let t_s = now.clock.at_s(batch.frame.tick);
                (now.t_s - t_s < STALE_S).then_some((batch, t_s))
            });
        fresh
            .filter_map(|(batch, t_s)| {
                let frame = &batch.frame;
                let [dx, dy] = frame.rect.offset_px.map(f64::from);
                let mark = |label: String, [x0, y0, x1, y1]: [f64; 4], colour| ContactBox {
                    label,
                    rect_px: [x0 - dx, y0 - dy, x1 - dx, y1 - dy],
                    colour,
                };
                // The truth goes by its colour: a text would lie upon that of the detection.
                let truth = frame.truth.iter().map(|seen| {
                    let colour = if seen.distractor { ORANGE } else { BLUE };
                    mark(String::new(), seen.box_px, colour)
                });
                let found = detector.drawn(&batch.detections).into_iter();
                let found = found.map(|d| mark(detector.caption(d), d.box_px, GREEN));
                let reticle = frame.reticle_px();
                let state = now.tracker.state_at(frame.tick).name();
                Some(ContactFrame {
                    camera: frame.name.to_string(),
                    time_s: t_s,
                    width: frame.rect.size_px[0] as u16,
                    height: frame.rect.size_px[1] as u16,
                    rgb8: frame.rgb8.as_ref()?.to_vec(),
                    boxes: truth.chain(found).collect(),
                    reticle_px: [reticle.x - dx, reticle.y - dy],
                    caption: format!("{state}; {why}"),
                })
            })
            .collect()
    }
}

/// Okabe and Ito's green for detections, sky blue for the UAV, orange for the others.
const GREEN: [u8; 3] = [0, 158, 115];
const BLUE: [u8; 3] = [86, 180, 233];
const ORANGE: [u8; 3] = [230, 159, 0];

/// How far the UAV stands out in a picture.
fn clutter_ratio(frame: &ExposedFrame, uav: &UavInFrame) -> Option<f64> {
    let [dx, dy] = frame.rect.offset_px.map(f64::from);
    let [x0, y0, x1, y1] = uav.box_px;
    let box_px = [x0 - dx, y0 - dy, x1 - dx, y1 - dy];
    signal_to_clutter(frame.rgb8.as_ref()?, frame.rect.size_px, box_px)
}

impl<'w> Now<'w> {
    /// What a tick left; `None` without a station.
    fn of(
        station: &mut QueryState<Station>,
        flying: &mut QueryState<Flying>,
        world: &'w World,
    ) -> Option<Self> {
        let clock = *world.resource::<SimClock>();
        let (station, mount, optics, beam, tracker, params) = station.single(world).ok()?;
        let mut flying: Vec<Thing> = (flying.iter(world))
            .map(|(uav, flight, shape, distractor, status)| Thing {
                index: uav.index,
                flight,
                shape,
                what: distractor.map_or(What::Uav, |d| What::Other(d.kind.name().into())),
                status: status.copied(),
                to_m: flight.aim_enu_m() - mount.r_enu_m,
            })
            .collect();
        flying.sort_unstable_by_key(|thing| thing.index);
        Some(Self {
            world,
            station,
            clock,
            t_s: clock.t_s(),
            tracker,
            candidate_hits: params.tuning.candidate_hits,
            r_station_enu_m: mount.r_enu_m,
            optics,
            firing: beam.firing,
            flying,
        })
    }

    /// What lies on a line of sight from the station.
    fn on(&self, direction_enu: DVec3) -> What {
        let nearest = self.thing_on(direction_enu);
        nearest.map_or(What::Scenery, |thing| thing.what.clone())
    }

    /// Of all that flies on a line of sight from the station, the nearest to it.
    fn thing_on(&self, direction_enu: DVec3) -> Option<&Thing<'w>> {
        let things = (self.flying.iter()).map(|thing| (thing, thing.to_m, thing.shape.radius_m));
        on_sight(things, direction_enu)
    }

    /// What is believed of every track that may be a target and has been seen lately, and what it is.
    fn beliefs(&self) -> impl Iterator<Item = Believed> {
        let tracks = self.tracker.table.tracks.iter();
        let judged = tracks.filter(|track| {
            track.total_hits() >= self.candidate_hits && self.t_s - track.seen_s() < LATELY_S
        });
        judged.filter_map(|track| {
            let belief = self.tracker.beliefs.get(&track.id)?;
            let los = track.filter.predicted(self.t_s).az_el_rad();
            Some(Believed::new(self.on(az_el_to_los(los)), belief))
        })
    }

    /// What the tracker's target is.
    fn target(&self) -> Option<What> {
        let track = self.tracker.target_track()?;
        let los = track.filter.predicted(self.t_s).az_el_rad();
        Some(self.on(az_el_to_los(los)))
    }

    fn is_clear(&self, thing: &Thing) -> bool {
        let environment = self.world.resource::<Environment>();
        let r_enu_m = self.r_station_enu_m + thing.to_m;
        environment.line_of_sight(self.r_station_enu_m, r_enu_m) == LineOfSight::Clear
    }

    fn in_field(&self, (entity, camera): &(Entity, SensorCamera), thing: &Thing) -> bool {
        let Some(CameraView { pose, .. }) = self.world.get(*entity) else {
            return false;
        };
        let r_cam_m = pose.q_enu_cam.inverse() * (self.r_station_enu_m + thing.to_m - pose.r_enu_m);
        let px = camera.pinhole.project(r_cam_m);
        px.is_some_and(|px| camera.pinhole.contains(px))
    }

    /// Whether the rules allow fire at a UAV in clear sight: what lies behind it, and the sun.
    fn open(&self, uav: &Thing) -> bool {
        let environment = self.world.resource::<Environment>();
        let Some(rules) = self.world.get::<Rules>(self.station) else {
            return false;
        };
        let (direction, range_m) = (uav.to_m.normalize(), uav.to_m.length());
        let dsm = &environment.city.dsm;
        let behind = dsm.first_hit_kind(self.r_station_enu_m, direction, FAR_M);
        let sun = environment.backdrop.sun_dir_enu;
        rules.authorised
            && rules.refusal(range_m, behind).is_none()
            && !faces_sun(direction, sun, rules.sun_exclusion_rad)
    }

    /// Angle between the UAV and the nearest of the others [deg].
    fn nearest_deg(&self, uav: &Thing) -> Option<f64> {
        let others = self.flying.iter().filter(|thing| thing.what != What::Uav);
        let apart_rad = others.map(|other| other.to_m.angle_between(uav.to_m));
        apart_rad.reduce(f64::min).map(f64::to_degrees)
    }
}
