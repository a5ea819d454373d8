//! What a still shows, drawn from its seed: the view, the UAVs and the distractors.

use super::recipe::Recipe;
use super::scene::Scene;
use super::shares::{Background, Motion, choose, log_range, pick};
use super::stage::Placed;
use crate::models::bodies::Rotors;
use crate::models::bodies::raster;
use crate::models::flight::distractor::{DistractorKind, tumbling_attitude};
use crate::models::flight::multirotor::{Airframe, MAX_ROTORS, MultirotorState, Setpoint};
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::kinematics::{
    Pose, az_el_to_los, boresight_chain, los_to_az_el, wrap_pi,
};
use crate::models::maths::rng::Stream;
use crate::models::optics::camera::{Pinhole, PixelRect};
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// What a still shows.
#[derive(Clone, Debug)]
pub struct Still {
    /// The camera's pose.
    pub pose: Pose,
    /// How the UAVs fly.
    pub motion: Motion,
    /// All that flies in it.
    pub placed: Vec<Placed>,
}

/// Tries to find a view before another size or place is drawn.
const VIEW_TRIES: usize = 60;

/// Draws one still; `None` if the scene has no room for what was drawn, and another draw may do.
pub fn still(
    recipe: &Recipe,
    scene: &Scene,
    count: usize,
    motion: Motion,
    rng: &mut Stream,
) -> Option<Still> {
    let size_px = DVec2::new(
        f64::from(scene.camera.pinhole.width_px),
        f64::from(scene.camera.pinhole.height_px),
    );
    let px = place_px(size_px, rng);
    let first = match count {
        // The view that a UAV there would have had.
        0 => {
            let range_m = log_range([30.0, 300.0], rng);
            let pose = view(recipe, scene, px, range_m, 10.0, rng)?;
            return Some(Still {
                pose,
                motion,
                placed: distractors(recipe, scene, &pose, None, rng),
            });
        }
        _ => target(recipe, scene, motion, rng)?,
    };
    let pose = view(recipe, scene, px, first.range_m, first.size_px, rng)?;
    let mut placed = vec![first.at(&scene.camera.pinhole, &pose, px)];
    let mut taken = vec![(px, first.size_px)];
    if !clear(scene, &pose, &placed[0]) {
        return None;
    }
    for _ in 1..count {
        for _ in 0..10 {
            let px = place_px(size_px, rng);
            let Some(other) = target(recipe, scene, motion, rng) else {
                continue;
            };
            let apart = |(at, size): &(DVec2, f64)| at.distance(px) > size + other.size_px;
            let other_placed = other.at(&scene.camera.pinhole, &pose, px);
            if placed.iter().all(|p| p.prop != other.prop)
                && taken.iter().all(apart)
                && clear(scene, &pose, &other_placed)
            {
                placed.push(other_placed);
                taken.push((px, other.size_px));
                break;
            }
        }
    }
    placed.extend(distractors(recipe, scene, &pose, Some(taken[0]), rng));
    Some(Still {
        pose,
        motion,
        placed,
    })
}

/// A point of the picture, one in eight near its border.
fn place_px(size_px: DVec2, rng: &mut Stream) -> DVec2 {
    let mut at = DVec2::new(rng.uniform(), rng.uniform());
    if rng.uniform() < 0.125 {
        let axis = pick(2, rng);
        let depth = 0.03 * rng.uniform();
        at[axis] = if rng.uniform() < 0.5 {
            depth
        } else {
            1.0 - depth
        };
    }
    at * size_px
}

/// A UAV to be placed: which, how big, how it is turned.
struct Target {
    prop: usize,
    size_px: f64,
    range_m: f64,
    q_enu_body: DQuat,
    phase_rad: [f64; MAX_ROTORS],
    speed_radps: [f64; MAX_ROTORS],
}

impl Target {
    fn at(&self, pinhole: &Pinhole, pose: &Pose, px: DVec2) -> Placed {
        let r_enu_m = pose.r_enu_m + self.range_m * (pose.q_enu_cam * pinhole.ray(px));
        Placed {
            prop: self.prop,
            body: (r_enu_m, self.q_enu_body),
            phase_rad: self.phase_rad,
            speed_radps: self.speed_radps,
        }
    }
}

fn target(recipe: &Recipe, scene: &Scene, motion: Motion, rng: &mut Stream) -> Option<Target> {
    let targets = &recipe.targets;
    let (classes, shares) = targets.shares();
    let class = classes[choose(&shares, rng)];
    let of_class: Vec<usize> = (0..scene.uavs.len())
        .filter(|i| scene.uavs[*i].class == class)
        .collect();
    let prop = *of_class.get(pick(of_class.len(), rng))?;
    let [least, most] = targets.size_px;
    let size_px = if rng.uniform() < targets.even_share {
        log_range(targets.size_px, rng)
    } else {
        // The mode of a log-normal distribution lies sigma^2 below its median.
        let mode = targets.mode_width_share * f64::from(scene.camera.pinhole.width_px);
        let median = mode.ln() + targets.log_sigma.powi(2);
        (median + targets.log_sigma * rng.normal()).exp()
    };
    let q_enu_body = attitude(motion, rng);
    let mut phase_rad = [0.0; MAX_ROTORS];
    phase_rad.fill_with(|| rng.range(0.0, TAU));
    let speed_radps = rotor_speeds_radps(scene, prop, rng);
    if !(least..=most).contains(&size_px) {
        return None;
    }
    let mut target = Target {
        prop,
        size_px,
        range_m: 0.0,
        q_enu_body,
        phase_rad,
        speed_radps,
    };
    target.range_m = range_for(scene, &target)?;
    let [nearest, farthest] = targets.range_m;
    let seen_m = 0.7 * scene.environment.weather.visibility_m;
    (nearest..=farthest.min(seen_m))
        .contains(&target.range_m)
        .then_some(target)
}

/// Speeds of a UAV's rotors [rad/s]: those at which it hovers, more and less by a sixth as it is steered.
fn rotor_speeds_radps(scene: &Scene, prop: usize, rng: &mut Stream) -> [f64; MAX_ROTORS] {
    let hover = Setpoint {
        r_enu_m: DVec3::ZERO,
        v_enu_mps: DVec3::ZERO,
        a_enu_mps2: DVec3::ZERO,
        yaw_rad: 0.0,
    };
    let airframe = Airframe::new(&scene.uavs[prop]);
    let density_kgpm3 = scene.environment.air_density_kgpm3;
    let hovering = MultirotorState::trimmed(&airframe, &hover, DVec3::ZERO, density_kgpm3);
    (hovering.rotor_speed_radps).map(|speed_radps| speed_radps * rng.range(5.0 / 6.0, 7.0 / 6.0))
}

/// The range at which a UAV has the size wanted, seen level from the south [m].
fn range_for(scene: &Scene, target: &Target) -> Option<f64> {
    const SIDE_PX: u32 = 512;
    const LONG_PX: f64 = 100.0; // [px], as it is measured
    let pinhole = Pinhole {
        width_px: SIDE_PX,
        height_px: SIDE_PX,
        focal_px: 20_000.0,
    };
    let [length, width, _] = scene.uavs[target.prop].size_m;
    let range_m = pinhole.focal_px * length.max(width) / LONG_PX;
    let zero = DVec3::ZERO;
    let pose = boresight_chain(zero, zero, 0.0, 0.0, DVec2::ZERO, zero);
    let masks = raster::fine_silhouette(
        &pinhole,
        &pose,
        (DVec3::Y * range_m, target.q_enu_body),
        Rotors {
            phase_rad: &target.phase_rad,
            speed_radps: &target.speed_radps,
            exposure_s: 0.0,
        },
        &scene.props[target.prop].mesh,
        PixelRect {
            offset_px: [0, 0],
            size_px: [SIDE_PX; 2],
        },
    );
    let [w, h] = masks.rect.size_px;
    let long_px = f64::from(w.max(h));
    Some(range_m * long_px / target.size_px * scene.camera.pinhole.focal_px / pinhole.focal_px)
}

/// An attitude that fits a way to fly.
fn attitude(motion: Motion, rng: &mut Stream) -> DQuat {
    let yaw = DQuat::from_rotation_z(rng.range(0.0, TAU));
    let tilt = |rng: &mut Stream, most_deg: f64, least_deg: f64| {
        let axis = DVec2::from_angle(rng.range(0.0, TAU)).extend(0.0);
        let angle_rad = rng.range(least_deg, most_deg).to_radians();
        DQuat::from_axis_angle(axis, angle_rad)
    };
    match motion {
        Motion::Level => yaw * tilt(rng, 8.0, 0.0),
        Motion::Manoeuvre => yaw * tilt(rng, 60.0, 8.0),
        Motion::ClimbDive => {
            let nose_rad = rng.range(-35.0, 35.0).to_radians();
            yaw * DQuat::from_rotation_y(nose_rad) * tilt(rng, 8.0, 0.0)
        }
    }
}

/// Whether the camera's sight line to a prop is free.
fn clear(scene: &Scene, pose: &Pose, placed: &Placed) -> bool {
    scene.environment.line_of_sight(pose.r_enu_m, placed.body.0) == LineOfSight::Clear
}

/// The elevation above which nothing but sky is seen in a direction [rad].
fn skyline_rad(scene: &Scene, az_rad: f64) -> f64 {
    let dsm = &scene.environment.city.dsm;
    let (mut low, mut high) = (-0.5, 1.45); // [rad]
    for _ in 0..14 {
        let middle = 0.5 * (low + high);
        let dir = az_el_to_los(DVec2::new(az_rad, middle));
        match dsm.first_hit(scene.camera.r_enu_m, dir, 8_000.0) {
            Some(_) => low = middle,
            None => high = middle,
        }
    }
    high
}

/// Where a target stands against the line between ground and sky.
enum Place {
    /// Before the ground.
    Below,
    /// Close above the line.
    Above,
    /// In the sky, with the line in the picture.
    High,
}

/// The pose that shows a point at `range_m` in pixel `px` before the scene's background.
fn view(
    recipe: &Recipe,
    scene: &Scene,
    px: DVec2,
    range_m: f64,
    size_px: f64,
    rng: &mut Stream,
) -> Option<Pose> {
    let pinhole = &scene.camera.pinhole;
    let dsm = &scene.environment.city.dsm;
    let roll_rad = rng.normal() * 1.5f64.to_radians();
    let place = match rng.uniform() {
        u if u < 0.5 => Place::Below,
        u if u < 0.75 => Place::Above,
        _ => Place::High,
    };
    let top = (rng.uniform() < 0.15 && !scene.tops_enu_m.is_empty())
        .then(|| scene.tops_enu_m[pick(scene.tops_enu_m.len(), rng)]);
    let far_up = rng.uniform() < recipe.camera.from_below;
    let size_rad = size_px / pinhole.focal_px;
    let (hfov_rad, vfov_rad) = (pinhole.hfov_rad(), pinhole.vfov_rad());
    for _ in 0..VIEW_TRIES {
        let az_rad = match top {
            Some(top) => {
                let at = los_to_az_el(top - scene.camera.r_enu_m);
                at.x + 0.4 * hfov_rad * rng.range(-1.0, 1.0)
            }
            None => rng.range(0.0, TAU),
        };
        let skyline = skyline_rad(scene, az_rad);
        let pose = match (scene.background, &place) {
            (Background::Sky, _) => {
                let sides = [-0.5, -0.25, 0.25, 0.5];
                let skyline = sides
                    .map(|side| skyline_rad(scene, az_rad + side * hfov_rad))
                    .into_iter()
                    .fold(skyline, f64::max);
                let above_rad = if far_up {
                    rng.range(10.0, 60.0).to_radians()
                } else {
                    // Low over the roofs is where UAVs are looked for.
                    -9f64.to_radians() * rng.uniform().max(1e-9).ln()
                };
                let low_rad = skyline + 0.55 * vfov_rad;
                let el_rad = match top {
                    Some(top) => {
                        let at = los_to_az_el(top - scene.camera.r_enu_m);
                        low_rad.max(at.y + 0.4 * vfov_rad * rng.range(-1.0, 1.0))
                    }
                    None => low_rad + above_rad,
                };
                looking(scene, az_rad, el_rad, roll_rad)
            }
            (_, Place::Below) => {
                let depth_rad = (0.5 * vfov_rad).min(0.15);
                let el_rad = skyline - size_rad * 0.5 - depth_rad * rng.uniform().powi(2);
                shown_at(scene, az_rad, el_rad, roll_rad, px)
            }
            (_, Place::Above) => {
                let el_rad = skyline + size_rad * rng.range(0.5, 6.0);
                shown_at(scene, az_rad, el_rad, roll_rad, px)
            }
            (_, Place::High) => {
                // The line lies in the lower half of the picture.
                let el_rad = skyline + vfov_rad * rng.range(0.05, 0.45);
                looking(scene, az_rad, el_rad, roll_rad)
            }
        };
        let dir = pose.q_enu_cam * pinhole.ray(px);
        let hit = dsm.first_hit(scene.camera.r_enu_m, dir, 8_000.0);
        let below = scene.background != Background::Sky && matches!(place, Place::Below);
        let fits = match hit {
            None => !below,
            Some(hit_m) => below && hit_m > 1.02 * range_m + 1.0,
        };
        let up = (pose.q_enu_cam * DVec3::Z).z;
        if fits && up < 70f64.to_radians().sin() {
            return Some(pose);
        }
    }
    None
}

/// The pose with this boresight [rad].
pub fn looking(scene: &Scene, az_rad: f64, el_rad: f64, roll_rad: f64) -> Pose {
    boresight_chain(
        scene.camera.r_enu_m,
        DVec3::ZERO,
        az_rad,
        el_rad,
        DVec2::ZERO,
        DVec3::Z * roll_rad,
    )
}

/// The pose that shows a direction in pixel `px`.
fn shown_at(scene: &Scene, az_rad: f64, el_rad: f64, roll_rad: f64, px: DVec2) -> Pose {
    let gaze = gaze_at(scene, DVec2::new(az_rad, el_rad), roll_rad, px);
    looking(scene, gaze.x, gaze.y, roll_rad)
}

/// Azimuth and elevation of the boresight [rad] that show a direction `at` [rad] in pixel `px`.
pub fn gaze_at(scene: &Scene, at: DVec2, roll_rad: f64, px: DVec2) -> DVec2 {
    let mut gaze = at;
    for _ in 0..4 {
        let pose = looking(scene, gaze.x, gaze.y, roll_rad);
        let shown = los_to_az_el(pose.q_enu_cam * scene.camera.pinhole.ray(px));
        gaze += DVec2::new(wrap_pi(at.x - shown.x), at.y - shown.y);
    }
    gaze
}

/// Birds and the like: one of them close to a UAV at (place, size) [px] and of its size, now and then,
/// the others anywhere in the picture.
fn distractors(
    recipe: &Recipe,
    scene: &Scene,
    pose: &Pose,
    uav: Option<(DVec2, f64)>,
    rng: &mut Stream,
) -> Vec<Placed> {
    /// So close a distractor may be taken for the UAV by the tracker [rad].
    const NEAR_RAD: f64 = 0.035;
    let wanted = &recipe.distractors;
    let share = if uav.is_some() {
        wanted.share
    } else {
        wanted.alone
    };
    if rng.uniform() >= share {
        return Vec::new();
    }
    let pinhole = &scene.camera.pinhole;
    let size_px = DVec2::new(f64::from(pinhole.width_px), f64::from(pinhole.height_px));
    let mut near = uav.filter(|_| rng.uniform() < wanted.near);
    let mut free: Vec<usize> = (scene.uavs.len()..scene.props.len()).collect();
    let mut placed = Vec::new();
    for _ in 0..1 + pick(3, rng) {
        let Some(prop) = pick_distractor(recipe, scene, &free, rng) else {
            continue;
        };
        let (px, long_px) = match near.take() {
            Some((px, long_px)) => {
                let own_px = long_px * log_range([0.4, 2.5], rng);
                let least_px = 0.7 * (own_px + long_px);
                let most_px = (NEAR_RAD * pinhole.focal_px).max(2.0 * least_px);
                let apart_px = log_range([least_px, most_px.min(0.5 * size_px.x)], rng);
                let at = px + apart_px * DVec2::from_angle(rng.range(0.0, TAU));
                (at.clamp(DVec2::ZERO, size_px), own_px)
            }
            None => {
                let px = DVec2::new(rng.uniform(), rng.uniform()) * size_px;
                (px, log_range(wanted.size_px, rng))
            }
        };
        let flies_in_flock = rng.uniform() < wanted.flock;
        let (mates, rest): (Vec<usize>, Vec<usize>) = free.into_iter().partition(|mate| {
            *mate == prop
                || flies_in_flock && Arc::ptr_eq(&scene.props[*mate].mesh, &scene.props[prop].mesh)
        });
        free = rest;
        let spread_px = long_px * rng.range(2.0, 6.0);
        for (number, mate) in mates.into_iter().enumerate() {
            let offset_px = spread_px * DVec2::new(rng.normal(), 0.6 * rng.normal());
            let at_px = if number == 0 { px } else { px + offset_px };
            let mate_px = long_px * rng.range(0.85, 1.15);
            placed.extend(placed_distractor(scene, pose, mate, at_px, mate_px, rng));
        }
    }
    placed
}

/// A prop among those free, its class drawn by the recipe's shares.
fn pick_distractor(
    recipe: &Recipe,
    scene: &Scene,
    free: &[usize],
    rng: &mut Stream,
) -> Option<usize> {
    let (classes, shares) = recipe.distractors.shares();
    let class = classes[choose(&shares, rng)];
    let of_class: Vec<usize> = (free.iter().copied())
        .filter(|prop| scene.props[*prop].distractor.map(DistractorKind::class) == Some(class))
        .collect();
    (!of_class.is_empty()).then(|| of_class[pick(of_class.len(), rng)])
}

/// A distractor at `px`, so far away that it is `long_px` long.
fn placed_distractor(
    scene: &Scene,
    pose: &Pose,
    prop: usize,
    px: DVec2,
    long_px: f64,
    rng: &mut Stream,
) -> Option<Placed> {
    let pinhole = &scene.camera.pinhole;
    let kind = scene.props[prop].distractor?;
    let reach_m = (scene.props[prop].mesh.outline_body_m().iter())
        .map(|p| p.length())
        .fold(0.0, f64::max);
    let range_m = (2.0 * pinhole.focal_px * reach_m / long_px).clamp(3.0, 15_000.0);
    let (t_s, phase_rad) = (rng.range(0.0, 60.0), rng.range(0.0, TAU));
    let q_enu_body = match kind {
        DistractorKind::Leaf => tumbling_attitude(t_s, phase_rad),
        DistractorKind::Balloon => attitude(Motion::Level, rng),
        // What flies on wings or a rotor banks into its turns; what soars always turns.
        _ => {
            let steep = if kind == DistractorKind::Raptor {
                0.8
            } else {
                0.3
            };
            let most_deg = if rng.uniform() < steep { 40.0 } else { 6.0 };
            let bank_rad = rng.range(-most_deg, most_deg).to_radians();
            let nose_rad = (8.0 * rng.normal()).clamp(-25.0, 25.0).to_radians();
            DQuat::from_rotation_z(rng.range(0.0, TAU))
                * DQuat::from_rotation_y(nose_rad)
                * DQuat::from_rotation_x(bank_rad)
        }
    };
    let dir = pose.q_enu_cam * pinhole.ray(px);
    Some(Placed {
        prop,
        body: (pose.r_enu_m + range_m * dir, q_enu_body),
        phase_rad: kind.phases_rad(t_s, phase_rad),
        speed_radps: kind.rotor_speeds_radps(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attitudes_fit_the_way_to_fly() {
        let mut rng = Stream::new(2, 0, "test");
        for (motion, least_deg, most_deg) in [
            (Motion::Level, 0.0, 8.0),
            (Motion::Manoeuvre, 8.0, 60.0),
            (Motion::ClimbDive, 0.0, 43.0),
        ] {
            for _ in 0..500 {
                let up = attitude(motion, &mut rng) * DVec3::Z;
                let tilt_deg = up.angle_between(DVec3::Z).to_degrees();
                assert!(
                    (least_deg - 1e-6..=most_deg + 1e-6).contains(&tilt_deg),
                    "{motion:?}: {tilt_deg}"
                );
            }
        }
    }

    #[test]
    fn a_uav_is_drawn_at_the_size_and_place_that_were_asked_for() {
        let recipe = Recipe::default();
        let scene = Scene::draw(&recipe, 3, Background::Sky).unwrap();
        let mut rng = Stream::new(3, 0, "test");
        let mut found = 0;
        for _ in 0..40 {
            let Some(target) = target(&recipe, &scene, Motion::Level, &mut rng) else {
                continue;
            };
            // Within the picture, away from its borders.
            let px = DVec2::new(0.4, 0.6)
                * DVec2::new(
                    f64::from(scene.camera.pinhole.width_px),
                    f64::from(scene.camera.pinhole.height_px),
                );
            let direction = DVec2::new(0.7, 0.2);
            let pose = shown_at(&scene, direction.x, direction.y, 0.03, px);
            let placed = target.at(&scene.camera.pinhole, &pose, px);
            let r_cam_m = pose.q_enu_cam.inverse() * (placed.body.0 - pose.r_enu_m);
            assert!((scene.camera.pinhole.project(r_cam_m).unwrap() - px).length() < 1e-6);
            let shown = los_to_az_el(placed.body.0 - pose.r_enu_m);
            assert!((shown - direction).length() < 1e-5, "{shown}");
            let masks = raster::fine_silhouette(
                &scene.camera.pinhole,
                &pose,
                placed.body,
                placed.rotors(0.0),
                &scene.props[placed.prop].mesh,
                PixelRect {
                    offset_px: [0, 0],
                    size_px: [
                        scene.camera.pinhole.width_px,
                        scene.camera.pinhole.height_px,
                    ],
                },
            );
            let Some(seen) = super::super::label::label(&masks, |_, _| 1.0) else {
                continue;
            };
            let [x0, y0, x1, y1] = seen.box_px;
            let long_px = (x1 - x0).max(y1 - y0);
            // It is seen from another side than that it is measured from, and thin tips do not count.
            let ratio = long_px / target.size_px;
            assert!(
                (0.4..1.6).contains(&ratio),
                "{long_px} for {}",
                target.size_px
            );
            found += 1;
        }
        assert!(found > 10, "{found}");
    }
}
