//! What falls: a box that tumbles on to the city below it, under gravity and a force, by Rapier.
//!
//! Each fall has a world of its own, in f32 about the place where it began: a box and a patch of
//! city, put in in that order. Rejected: one world for all that fall, filled from the ECS. How
//! Rapier numbers what it is given decides the last digits of a contact, and a query over two new
//! archetypes comes in the order of a hash map: with any component more in the program a wreck
//! came to rest some millimetres aside.

use crate::ground::dsm::{Dsm, Solids};
use crate::maths::kinematics::GRAVITY_MPS2;
use glam::{DQuat, DVec3};
use rapier3d::parry::utils::Array2;
use rapier3d::prelude::*;

/// Friction of a wreck, and of the city; Rapier takes the mean.
const WRECK_FRICTION: f32 = 0.6;
const CITY_FRICTION: f32 = 0.8;
/// Share of the speed with which a wreck leaves what it meets; the city has none, and Rapier takes the mean.
const WRECK_RESTITUTION: f32 = 0.2;

/// What begins to fall: a box.
#[derive(Clone, Copy, Debug)]
pub struct Falling {
    /// Length, width and height [m].
    pub size_m: [f64; 3],
    /// Its mass [kg].
    pub mass_kg: f64,
    /// Its attitude, from the body's axes to `enu`.
    pub q_enu_body: DQuat,
    /// Its velocity in `enu` [m/s].
    pub v_enu_mps: DVec3,
    /// Its angular velocity in the body's axes [rad/s].
    pub omega_body_radps: DVec3,
}

/// One fall, seen from where it began.
pub struct Fall {
    world: PhysicsWorld,
    body: RigidBodyHandle,
}

impl Clone for Fall {
    /// A copy that goes on bit for bit: what of Rapier's world is workspace alone begins anew.
    fn clone(&self) -> Self {
        let PhysicsWorld {
            gravity,
            integration_parameters,
            physics_pipeline: _,
            islands,
            broad_phase,
            narrow_phase,
            bodies,
            colliders,
            impulse_joints,
            multibody_joints,
            ccd_solver: _,
        } = &self.world;
        let world = PhysicsWorld {
            gravity: *gravity,
            integration_parameters: *integration_parameters,
            islands: islands.clone(),
            broad_phase: broad_phase.clone(),
            narrow_phase: narrow_phase.clone(),
            bodies: bodies.clone(),
            colliders: colliders.clone(),
            impulse_joints: impulse_joints.clone(),
            multibody_joints: multibody_joints.clone(),
            ..PhysicsWorld::new()
        };
        Self {
            world,
            body: self.body,
        }
    }
}

impl Fall {
    /// Lets a box go above a patch of city, to be stepped by `step_s` [s].
    pub fn new(falling: &Falling, city: Option<ColliderBuilder>, step_s: f64) -> Self {
        let mut world = PhysicsWorld::new();
        world.gravity = Vec3::NEG_Z * GRAVITY_MPS2 as f32;
        world.integration_parameters.dt = step_s as f32;
        if let Some(city) = city {
            world.insert(RigidBodyBuilder::fixed(), city.friction(CITY_FRICTION));
        }
        let omega_enu_radps = falling.q_enu_body * falling.omega_body_radps;
        let [length, width, height] = falling.size_m.map(|side| side as f32 / 2.0);
        let (body, _) = world.insert(
            RigidBodyBuilder::dynamic()
                .pose(Pose::from_rotation(falling.q_enu_body.as_quat()))
                .linvel(falling.v_enu_mps.as_vec3())
                .angvel(omega_enu_radps.as_vec3())
                .ccd_enabled(true),
            ColliderBuilder::cuboid(length, width, height)
                .mass(falling.mass_kg as f32)
                .friction(WRECK_FRICTION)
                .restitution(WRECK_RESTITUTION),
        );
        Self { world, body }
    }

    /// Moves it on by one step, under a force in `enu` [N] besides its weight.
    pub fn step(&mut self, force_enu_n: DVec3) {
        let body = &mut self.world.bodies[self.body];
        body.reset_forces(true);
        body.add_force(force_enu_n.as_vec3(), true);
        self.world.step();
    }

    /// Where it is, from where it began, in `enu` [m].
    pub fn moved_enu_m(&self) -> DVec3 {
        self.body().translation().as_dvec3()
    }

    /// Its attitude, from the body's axes to `enu`.
    pub fn q_enu_body(&self) -> DQuat {
        self.body().rotation().as_dquat().normalize()
    }

    /// Its velocity in `enu` [m/s].
    pub fn v_enu_mps(&self) -> DVec3 {
        self.body().linvel().as_dvec3()
    }

    /// Its angular velocity in the body's axes [rad/s].
    pub fn omega_body_radps(&self) -> DVec3 {
        self.q_enu_body().inverse() * self.body().angvel().as_dvec3()
    }

    fn body(&self) -> &RigidBody {
        &self.world.bodies[self.body]
    }
}

/// The columns of a height raster within `half_m` [m] of a place, as heights `step_m` [m] apart.
pub fn columns(dsm: &Dsm, origin_enu_m: DVec3, half_m: f64, step_m: f64) -> ColliderBuilder {
    let n = (2.0 * half_m / step_m) as usize + 1;
    let mut heights = vec![0.0; n * n];
    for column in 0..n {
        for row in 0..n {
            let e = origin_enu_m.x - half_m + column as f64 * step_m;
            let north = origin_enu_m.y + half_m - row as f64 * step_m;
            heights[column * n + row] = (dsm.surface_m(e, north) - origin_enu_m.z) as f32;
        }
    }
    let side = 2.0 * half_m as f32;
    // Rapier's height field spans x (columns) and z (rows) and rises along y: turned by a quarter
    // about east, its z runs to the south.
    ColliderBuilder::heightfield(Array2::new(n, n, heights), Vec3::new(side, 1.0, side))
        .rotation(Vec3::X * std::f32::consts::FRAC_PI_2)
}

/// The triangles within `half_m` [m] of a place on the map; `None` where there are none.
pub fn triangles(solids: &Solids, origin_enu_m: DVec3, half_m: f64) -> Option<ColliderBuilder> {
    let half = DVec3::new(half_m, half_m, f64::INFINITY);
    let found = solids
        .triangles
        .in_box(origin_enu_m - half, origin_enu_m + half);
    let corners = found.iter().flat_map(|triangle| {
        let corners = solids.triangles.corners_m(*triangle);
        corners.map(|corner| (corner - origin_enu_m).as_vec3())
    });
    let corners: Vec<Vec3> = corners.collect();
    let indices = (0..corners.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
    ColliderBuilder::trimesh(corners, indices.collect()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn falling() -> Falling {
        Falling {
            size_m: [0.4, 0.3, 0.2],
            mass_kg: 1.2,
            q_enu_body: DQuat::from_rotation_x(0.3),
            v_enu_mps: DVec3::new(6.0, -2.0, 3.0),
            omega_body_radps: DVec3::new(0.0, 0.0, 2.0),
        }
    }

    #[test]
    fn without_a_city_it_falls_for_ever_on_a_parabola() {
        let step_s = 0.01;
        let mut fall = Fall::new(&falling(), None, step_s);
        for _ in 0..100 {
            fall.step(DVec3::X * 1.2);
        }
        // One newton a kilogram to the east, for one second.
        let exact = DVec3::new(6.5, -2.0, 3.0 - 0.5 * GRAVITY_MPS2);
        // A step of Euler's method errs by half the acceleration, a step and the time.
        let error = fall.moved_enu_m() - exact;
        assert!(
            error.length() < 0.55 * step_s * GRAVITY_MPS2,
            "{error} after a second"
        );
        assert!((fall.omega_body_radps().length() - 2.0).abs() < 1e-3);
        let v = fall.v_enu_mps() - DVec3::new(7.0, -2.0, 3.0 - GRAVITY_MPS2);
        assert!(v.length() < 1e-4, "{v}");
    }

    #[test]
    fn it_comes_to_rest_on_what_lies_below_it() {
        let corners = [(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)];
        let corners = corners.map(|(e, n)| Vec3::new(e, n, -2.0)).to_vec();
        let city = ColliderBuilder::trimesh(corners, vec![[0, 1, 2], [0, 2, 3]]).ok();
        let mut fall = Fall::new(
            &Falling {
                v_enu_mps: DVec3::ZERO,
                ..falling()
            },
            city,
            0.01,
        );
        for _ in 0..300 {
            fall.step(DVec3::ZERO);
        }
        assert!(fall.v_enu_mps().length() < 0.01, "{}", fall.v_enu_mps());
        let z = fall.moved_enu_m().z;
        assert!((z + 1.9).abs() < 0.01, "{z} m for half its height above");
    }
}
