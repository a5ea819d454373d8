//! One Bevy app that shows one scene after the other and renders single frames of them.

use super::error::DatasetError;
use crate::app::{self, Options, RunError};
use crate::components::capture::{Conditions, ExposedFrame, SensorCamera, Tier};
use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav, UavShape};
use crate::components::render::{SceneHandles, SensorViews};
use crate::models::bodies::{Rotors, UavMesh};
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::multirotor::{MAX_ROTORS, MultirotorState};
use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::exposure::ExposureControl;
use crate::models::optics::sensor::Sensor;
use crate::models::shape::mesh::MeshData;
use crate::systems::capture::{self, ImageScratch, Shot};
use crate::systems::render::renderer::{Renderer, settle, spawn_sensor_view};
use crate::systems::render::scene;
use bevy::prelude::*;
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// Samples a pixel of the renderer.
pub const ANTIALIAS: u32 = 4;

/// How the cameras of a set are exposed, apart from the longest time, which every scene draws.
pub const CONTROL: ExposureControl = ExposureControl {
    level: 0.5,
    time_s: [1e-6, 1.0 / 50.0], // [s]
    max_gain: 48.0,
    settling_s: 0.25, // [s]
};

/// What may appear in a scene: its meshes, and what it is.
#[derive(Clone)]
pub struct Prop {
    /// What it looks like.
    pub mesh: Arc<UavMesh>,
    /// The kind of one that is no UAV.
    pub distractor: Option<DistractorKind>,
}

/// One place for a prop in a still.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// Its index among the scene's props.
    pub prop: usize,
    /// Position and attitude.
    pub body: (DVec3, DQuat),
    /// Phases of its rotors or wings [rad].
    pub phase_rad: [f64; MAX_ROTORS],
    /// Speeds of its rotors [rad/s].
    pub speed_radps: [f64; MAX_ROTORS],
}

impl Placed {
    /// Its rotors or wings during an exposure [s].
    pub fn rotors(&self, exposure_s: f64) -> Rotors<'_> {
        Rotors {
            phase_rad: &self.phase_rad,
            speed_radps: &self.speed_radps,
            exposure_s,
        }
    }

    fn state(&self) -> MultirotorState {
        MultirotorState {
            rotor_speed_radps: self.speed_radps,
            rotor_phase_rad: self.phase_rad,
            ..standing(self.body)
        }
    }
}

/// The app and what it shows.
pub struct Stage {
    app: App,
    renderer: Renderer,
    /// Pixels of the frame rendered last.
    pub scratch: ImageScratch,
    root: Option<Entity>,
    views: Option<SensorViews>,
}

/// A frame as rendered, before the sensor.
pub struct Rendered {
    /// Pose, and the props' truth.
    pub frame: ExposedFrame,
    /// How it was rendered.
    pub shot: Shot,
    /// Identities by prop.
    pub digits: Vec<u32>,
    /// Exposure time that its rotors are smeared for [s].
    pub smeared_s: f64,
}

impl Stage {
    /// An empty stage.
    pub fn new(threads: Option<usize>) -> Result<Self, DatasetError> {
        app::adapter()?;
        let options = Options {
            threads,
            capture: true,
            log: true,
            ..Options::default()
        };
        let (app, renderer) = app::bevy_app(&options, |_| {});
        Ok(Self {
            app,
            renderer: renderer.ok_or(RunError::NoAdapter)?,
            scratch: ImageScratch::default(),
            root: None,
            views: None,
        })
    }

    /// Replaces what is shown by another scene.
    pub fn set(
        &mut self,
        environment: Environment,
        r_camera_enu_m: DVec3,
        size_px: [u32; 2],
        props: &[Prop],
        clutter: &[MeshData],
    ) {
        let world = self.app.world_mut();
        if let Some(root) = self.root.take() {
            world.entity_mut(root).despawn();
            let mut old = world.query_filtered::<Entity, With<Uav>>();
            let old: Vec<Entity> = old.iter(world).collect();
            for entity in old {
                world.despawn(entity);
            }
        }
        let tiles = environment.city.chunks();
        scene::spawn(world, &environment, tiles, &[r_camera_enu_m]);
        world.insert_resource(environment);
        let site_grid = world.resource::<SceneHandles>().site_grid;
        self.root = world.get::<ChildOf>(site_grid).map(|child| child.parent());
        for (index, prop) in props.iter().enumerate() {
            scene::spawn_uav(world, index, &prop.mesh, (DVec3::ZERO, DQuat::IDENTITY));
            world.spawn((
                Uav {
                    index,
                    name: String::new(),
                    size_m: [0.0; 3],
                },
                Flight {
                    state: standing((DVec3::ZERO, DQuat::IDENTITY)),
                    aim_body_m: prop.mesh.centroid_body_m(),
                },
                UavShape::new(prop.mesh.clone()),
            ));
        }
        for structure in clutter {
            scene::add_structure(world, structure);
        }
        let views = SensorViews {
            sizes: vec![(
                size_px,
                spawn_sensor_view(world, site_grid, size_px, ANTIALIAS),
            )],
            magnifiers: capture::spawn_magnifiers(world, site_grid),
        };
        // Where `settle` looks for them; a child of the scene, so that it goes with it.
        world.spawn((views.clone(), ChildOf(site_grid)));
        self.views = Some(views);
        settle(world, &mut self.renderer);
    }

    /// Renders what a camera sees of the props placed, exposed so; the others are not there.
    pub fn render(
        &mut self,
        pose: Pose,
        pinhole: Pinhole,
        sensor: &Sensor,
        conditions: Conditions,
        props: &[Prop],
        placed: &[Placed],
    ) -> Result<Rendered, DatasetError> {
        let smeared_s = sensor.smeared_s(&conditions.exposure);
        let world = self.app.world_mut();
        let views = self.views.clone().ok_or(RunError::NoAdapter)?;
        let camera = SensorCamera {
            index: 0,
            name: Tier::Search.name().into(),
            tier: Tier::Search,
            pinhole,
            period_ticks: 1,
            latency_ticks: 0,
            sensor: sensor.clone(),
            seeing: None,
            control: CONTROL,
            window_px: None,
            antialias: ANTIALIAS,
        };
        // Behind the camera, what is not placed is culled.
        let away_enu_m = pose.r_enu_m - 500.0 * (pose.q_enu_cam * DVec3::Z);
        let mut truth = Vec::new();
        let mut uavs = world.query::<(&Uav, &mut Flight, &UavShape)>();
        for (uav, mut flight, shape) in uavs.iter_mut(world) {
            let at = placed.iter().find(|placed| placed.prop == uav.index);
            flight.state = match at {
                Some(placed) => placed.state(),
                None => standing((away_enu_m, DQuat::IDENTITY)),
            };
            if at.is_some()
                && let Some(mut seen) = capture::projected(&pinhole, &pose, &flight, shape)
            {
                seen.uav = uav.index;
                seen.distractor = props[uav.index].distractor.is_some();
                truth.push(seen);
            }
        }
        truth.sort_by_key(|seen| seen.uav);
        let frame = ExposedFrame {
            pose,
            truth,
            conditions,
            ..ExposedFrame::bare(Tier::Search, pinhole)
        };
        let shots = [Shot::new(&frame, camera, &views, None)];
        let mut frames = [frame];
        let digits = capture::draw(world, &mut self.renderer, &frames, &shots);
        let ([frame], [shot]) = (&mut frames, &shots);
        let scratch = &mut self.scratch;
        capture::read(world, &mut self.renderer, frame, shot, &digits, scratch)?;
        let ([frame], [shot]) = (frames, shots);
        Ok(Rendered {
            frame,
            shot,
            digits,
            smeared_s,
        })
    }
}

fn standing((r_enu_m, q_enu_body): (DVec3, DQuat)) -> MultirotorState {
    MultirotorState {
        r_enu_m,
        v_enu_mps: DVec3::ZERO,
        q_enu_body,
        omega_body_radps: DVec3::ZERO,
        rotor_speed_radps: [0.0; MAX_ROTORS],
        rotor_phase_rad: [0.0; MAX_ROTORS],
        drag_estimate_enu_mps2: DVec3::ZERO,
    }
}
