//! Radar, search scan and control law from their scenario.

use crate::components::capture::{SensorCamera, Tier};
use crate::components::control::{
    Controller, PaperController, PointingController, PointingLaws, Radar, RadarKind, SearchScan,
};
use crate::components::run::{Seed, SimClock};
use crate::models::control::POINTING_LAWS;
use crate::models::control::law::HandOver;
use crate::models::control::paper::PaperLaw;
use crate::models::control::tuning::MountPlant;
use crate::models::sensing::radar::choice::CueChoice;
use crate::models::sensing::radar::tracks::RadarTracks;
use crate::models::sensing::radar::traffic::Traffic;
use crate::models::tracking::search::Sector;
use crate::scenario::{
    self, Cue, CueKind, Gains, InputError, Loaded, ResolvedStation, Scenario, SearchSector,
};
use std::collections::VecDeque;

/// The pointing laws that every run knows.
pub fn laws() -> PointingLaws {
    let mut laws = PointingLaws::default();
    for (name, make) in POINTING_LAWS {
        laws.add(name, make);
    }
    laws
}

/// A law of the paper with other gains, if there are any.
pub fn with_gains(law: PaperLaw, gains: Option<Gains>) -> PaperLaw {
    match gains {
        Some(Gains { kp, ki_per_s, kd_s }) => PaperLaw {
            kp,
            ki_per_s,
            kd_s,
            ..law
        },
        None => law,
    }
}

/// The controller of a scenario for the mount of the station that stands at `station` in the file.
pub fn controller(
    loaded: &Loaded,
    laws: &PointingLaws,
    station: &str,
    plant: &MountPlant,
) -> Result<Controller, InputError> {
    let settings = &loaded.scenario.controller;
    if settings.is_paper() {
        return Ok(Controller::Paper(Box::new(PaperController::new(
            with_gains(PaperLaw::COARSE, settings.coarse),
            with_gains(PaperLaw::PRECISE, settings.precise),
        ))));
    }
    let name = &settings.preset;
    let law = laws.make(name, plant).ok_or_else(|| {
        let known: Vec<&str> = laws.names().chain([scenario::PAPER]).collect();
        let hint = scenario::suggestion(name, &known);
        loaded.refuse("controller.preset", format!("no law '{name}'{hint}"))
    })?;
    let law = law.map_err(|error| {
        // The shipped laws' gains follow from the mount: where none is stable, the mount is what to change.
        let shipped = POINTING_LAWS.iter().any(|(shipped, _)| shipped == name);
        match shipped {
            true => loaded.refuse(&format!("{station}.mount"), error),
            false => loaded.refuse("controller.preset", error),
        }
    })?;
    Ok(Controller::Pointing(Box::new(PointingController {
        name: name.clone(),
        law,
        hand_over: HandOver::new(plant.mirror.stroke_rad, plant.dt_s),
    })))
}

/// The radar of a station, before its first look.
pub fn radar(
    scenario: &Scenario,
    search: &SearchSector,
    station: usize,
    seed: Seed,
    clock: SimClock,
) -> Radar {
    let (cue, entity) = (search.cue.as_ref(), station as u64);
    Radar {
        kind: cue.map(|cue| radar_kind(scenario, search, cue, seed, entity)),
        period_ticks: cue.map_or(1, |cue| clock.ticks_of(1.0 / cue.rate_hz).max(1)),
        latency_ticks: cue.map_or(0, |cue| clock.ticks_of(cue.latency_s)),
        dismissed: Vec::new(),
        rng: seed.stream(entity, "radar"),
        waiting: VecDeque::new(),
        tracks: RadarTracks::default(),
        choice: CueChoice::default(),
    }
}

/// What the plots of a cue come from.
fn radar_kind(
    scenario: &Scenario,
    search: &SearchSector,
    cue: &Cue,
    seed: Seed,
    entity: u64,
) -> RadarKind {
    if cue.kind == CueKind::Truth {
        let named = cue.target.as_ref();
        return RadarKind::Truth {
            errors: cue.errors(),
            target: named.and_then(|name| scenario.uavs.iter().position(|uav| uav.name == *name)),
            all: cue.all,
        };
    }
    let turned = seed.stream(entity, "radar alignment").normal3().truncate();
    let params = cue.scanning(search, cue.radar.alignment_deg.to_radians() * turned);
    let traffic = Traffic::new(
        cue.radar.vehicles,
        &params.field,
        params.farthest_m,
        seed.stream(entity, "radar traffic"),
    );
    RadarKind::Scanning(Box::new((params, traffic)))
}

/// Where cameras, which one gimbal turns, look for a target: the sector, or the part of it that the radar
/// points at.
pub fn search_scan(
    site: &ResolvedStation,
    cameras: Vec<&SensorCamera>,
    clock: &SimClock,
    radar: &Radar,
) -> SearchScan {
    let sector = site.search;
    let first_of = |tier: Tier| {
        let camera = cameras.iter().find(|camera| camera.tier == tier)?;
        let pinhole = &camera.pinhole;
        let field_rad = [pinhole.hfov_rad(), pinhole.vfov_rad()];
        Some((tier, field_rad, clock.at_s(camera.period_ticks)))
    };
    let searching: Vec<_> = Tier::ALL.into_iter().filter_map(first_of).collect();
    let area = Sector {
        centre_azimuth_rad: sector.centre_azimuth_deg.to_radians(),
        centre_elevation_rad: sector.elevation_deg.to_radians(),
        width_rad: sector.width_deg.to_radians(),
        height_rad: sector.height_deg.to_radians(),
    };
    let cue = radar.cue(0.0);
    SearchScan::new(sector.pattern, area, &searching, cue)
}
