//! Parametric UAV bodies and propellers at the catalogue's sizes, in body axes
//! (forward-left-up) about the centre of the rotors' square or hexagon; and the distractors that a
//! detector may take for UAVs: birds, balloons, aeroplanes, helicopters, leaves.
//!
//! The makers give a Phantom's, a Mavic's and the racer's size without propellers, the Matrices'
//! with them turning: hub positions and hull sizes follow from that and from the diagonal.

mod aeroplane;
mod birds;
mod distractors;
mod fittings;
mod helicopter;
mod kit;
mod matrice;
mod mavic;
mod parts;
mod phantom;
mod racer;
pub mod raster;
mod ribbed;
mod style;

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3};

use crate::flight::multirotor::MultirotorState;
use crate::flight::shape::{Coat, Frame, Shape};
use crate::flight::uav::{AimPart, UavModel};
use crate::laser::target::Parts;
use crate::shape::mesh::MeshData;
pub use distractors::{distractor_mesh, drawn_distractor_mesh};
use fittings::fit_out;
use kit::Kit;
use matrice::{matrice_200, matrice_600};
use mavic::mavic;
use parts::propeller;
use phantom::phantom;
use racer::racer;
use ribbed::ribbed;
pub use style::{FrameStyle, Gear, Payload, UavStyle};

/// Where a propeller, or a part of a bird's wing, sits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotorMount {
    /// Hub [m, body, or the axes of what carries it].
    pub hub_body_m: DVec3,
    /// Attitude of its mesh at phase 0; it turns about its own z.
    pub q_body_hub: DQuat,
    /// Phases that it goes through, from and to [rad].
    pub sweep_rad: [f64; 2],
    /// Whether it turns clockwise seen from above.
    pub clockwise: bool,
    /// Its mesh among [`UavMesh::blades`].
    pub blade: usize,
    /// The earlier rotor that carries it, as a bird's arm its hand; `None`: the body does.
    pub parent: Option<usize>,
}

/// A UAV to draw.
#[derive(Clone, Debug)]
pub struct UavMesh {
    /// All but the propellers [m, body].
    pub body: MeshData,
    /// Hubs, in the order of the flight model's rotors.
    pub rotors: Vec<RotorMount>,
    /// Propellers, or parts of wings, about their hubs, axis z [m].
    pub blades: Vec<MeshData>,
}

/// A UAV's rotors, or a bird's wings, during an exposure.
#[derive(Clone, Copy, Debug)]
pub struct Rotors<'a> {
    /// Their phases in its middle [rad].
    pub phase_rad: &'a [f64],
    /// Their speeds [rad/s].
    pub speed_radps: &'a [f64],
    /// How long it lasts [s]; at 0 they stand sharp.
    pub exposure_s: f64,
}

impl<'a> Rotors<'a> {
    /// Those of a state.
    pub fn of(state: &'a MultirotorState, exposure_s: f64) -> Self {
        Self {
            phase_rad: &state.rotor_phase_rad,
            speed_radps: &state.rotor_speed_radps,
            exposure_s,
        }
    }

    /// Where vertex `i` of the mesh of rotor `number` shows, about its hub at its phase [m].
    pub fn vertex_m(&self, number: usize, blade: &MeshData, i: usize) -> DVec3 {
        let speed_radps = self.speed_radps.get(number).copied().unwrap_or_default();
        let [share, half_chord_rad] = blade.uv[i].map(f64::from);
        let spacing_rad = f64::from(blade.surface[i][1]);
        let half_turn_rad = 0.5 * (speed_radps.abs() * self.exposure_s).min(spacing_rad);
        let turn_rad = sliver_turn_rad(share, half_chord_rad, half_turn_rad);
        DQuat::from_rotation_z(turn_rad) * DVec3::from_array(blade.positions[i].map(f64::from))
    }
}

/// How far a sliver of a blade is turned from its place in the middle of an exposure [rad], as
/// `assets/shaders/lean.wgsl` turns it: one `share` of the half chord from the blade's middle, -1 to 1, where
/// the half chord takes `half_chord_rad` about the hub and the blade turns by `half_turn_rad` before and after.
///
/// A blade shows at an angle for as long as it is there: the convolution of its box with that of the turn, a
/// trapezoid. Slivers keep their order and their widths, and lie as densely as that is high.
fn sliver_turn_rad(share: f64, half_chord_rad: f64, half_turn_rad: f64) -> f64 {
    if share == 0.0 || half_turn_rad <= 0.0 {
        return 0.0;
    }
    let sharp_rad = half_chord_rad * share.abs();
    let flat_rad = (half_chord_rad - half_turn_rad).abs();
    let inner_rad = sharp_rad * (half_turn_rad / half_chord_rad).max(1.0);
    let angle_rad = if inner_rad <= flat_rad {
        inner_rad
    } else {
        let rest = half_turn_rad * (half_chord_rad - sharp_rad);
        half_chord_rad + half_turn_rad - 2.0 * rest.max(0.0).sqrt()
    };
    share.signum() * (angle_rad - sharp_rad)
}

impl RotorMount {
    /// From its mesh to what carries it, at a phase [rad].
    fn at(&self, phase_rad: f64) -> DAffine3 {
        let turned = self.q_body_hub * DQuat::from_rotation_z(phase_rad);
        DAffine3::from_rotation_translation(turned, self.hub_body_m)
    }
}

impl UavMesh {
    /// Every rotor's mesh, and how it lies on the body, at phases [rad].
    pub fn blades_at(&self, phase_rad: &[f64]) -> Vec<(&MeshData, DAffine3)> {
        let mut placed: Vec<(&MeshData, DAffine3)> = Vec::with_capacity(self.rotors.len());
        for (mount, phase_rad) in self.rotors.iter().zip(phase_rad) {
            let carrier = mount.parent.map_or(DAffine3::IDENTITY, |i| placed[i].1);
            placed.push((&self.blades[mount.blade], carrier * mount.at(*phase_rad)));
        }
        placed
    }

    /// How a rotor's mesh lies on the body at phases spread over its sweep, and those of what
    /// carries it.
    fn swept(&self, mount: &RotorMount) -> Vec<DAffine3> {
        let [from, to] = mount.sweep_rad;
        let steps = if to - from < TAU { 4 } else { 16 };
        let carrier = mount.parent.map(|i| self.swept(&self.rotors[i]));
        let carrier = carrier.unwrap_or_else(|| vec![DAffine3::IDENTITY]);
        (carrier.iter())
            .flat_map(|carrier| {
                (0..=steps).map(move |i| {
                    let phase_rad = from + (to - from) * f64::from(i) / f64::from(steps);
                    *carrier * mount.at(phase_rad)
                })
            })
            .collect()
    }

    /// Where the middle of `part` of a UAV lies [m, body].
    pub fn part_body_m(&self, uav: &UavModel, part: AimPart) -> DVec3 {
        match part {
            AimPart::Body => (uav.body.at_body_m).unwrap_or_else(|| self.centroid_body_m()),
            AimPart::Battery => uav.battery.at_body_m,
            AimPart::RotorHub => (uav.rotor_hub.at_body_m)
                .or_else(|| self.rotors.first().map(|r| r.hub_body_m))
                .unwrap_or_default(),
            AimPart::Camera => uav.camera.at_body_m,
        }
    }

    /// What of a UAV lies where, for a beam that strikes it.
    pub fn parts(&self, uav: &UavModel) -> Parts {
        Parts {
            battery: (uav.battery.at_body_m, uav.battery.skin),
            camera: (uav.camera.at_body_m, uav.camera.skin),
            hubs: (
                self.rotors.iter().map(|rotor| rotor.hub_body_m).collect(),
                uav.rotor_hub.skin,
            ),
            body: uav.body.skin,
            arms: uav.arms,
            diagonal_m: uav.diagonal_m,
        }
    }

    /// Centroid of the surface without propellers or wings [m, body]: about where an image has its
    /// middle.
    pub fn centroid_body_m(&self) -> DVec3 {
        let body = &self.body;
        let point = |i: u32| DVec3::from_array(body.positions[i as usize].map(f64::from));
        let (moment, area) =
            body.indices
                .chunks_exact(3)
                .fold((DVec3::ZERO, 0.0), |(moment, area), triangle| {
                    let [p, q, r] = [0, 1, 2].map(|i| point(triangle[i]));
                    let twice = (q - p).cross(r - p).length();
                    (moment + twice * (p + q + r) / 3.0, area + twice)
                });
        if area > 0.0 {
            moment / area
        } else {
            DVec3::ZERO
        }
    }

    /// Points whose projections' box holds that of the body and of what its rotors or wings sweep
    /// [m, body].
    pub fn outline_body_m(&self) -> Vec<DVec3> {
        let point = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let mut outline: Vec<DVec3> = self.body.positions.iter().map(point).collect();
        for mount in &self.rotors {
            let points: Vec<DVec3> = (self.blades[mount.blade].positions.iter())
                .map(point)
                .collect();
            // What turns all around reaches as far as its tip does.
            let turns = mount.sweep_rad[1] - mount.sweep_rad[0] >= TAU;
            let tip_m = (points.iter())
                .map(|p| p.truncate().length())
                .fold(0.0, f64::max);
            let points = if turns {
                vec![DVec3::X * tip_m]
            } else {
                points
            };
            for at in self.swept(mount) {
                outline.extend(points.iter().map(|p| at.transform_point3(*p)));
            }
        }
        outline
    }

    /// Length, width and height of the box that holds it, rotors and wings in any phase [m].
    pub fn size_m(&self) -> [f64; 3] {
        let outline = self.outline_body_m();
        let low = outline.iter().copied().reduce(DVec3::min);
        let high = outline.iter().copied().reduce(DVec3::max);
        (high.unwrap_or_default() - low.unwrap_or_default()).to_array()
    }
}

/// The body, hubs and propeller of a UAV as its maker publishes it.
pub fn uav_mesh(uav: &UavModel) -> UavMesh {
    styled_uav_mesh(uav, &UavStyle::standard())
}

/// The body, hubs and propeller of a UAV in a given style. The flight model knows nothing of its
/// payload and gear.
pub fn styled_uav_mesh(uav: &UavModel, style: &UavStyle) -> UavMesh {
    let coat = style.coat.unwrap_or(uav.coat);
    let lowered = style.gear == Gear::Lowered;
    let (mut body, hubs_body_m) = match (style.frame, &uav.shape) {
        (FrameStyle::Ribbed, _) => built(Frame::Ribbed, uav, coat, lowered),
        (FrameStyle::Maker, Shape::Frame(frame)) => built(*frame, uav, coat, lowered),
        (FrameStyle::Maker, Shape::Own { body, hubs_body_m }) => {
            (MeshData::clone(body), hubs_body_m.clone())
        }
    };
    fit_out(&mut body, &hubs_body_m, uav, style, &coat);
    let rotor = propeller(uav.propeller_diameter_m / 2.0, style.blades, coat.blades);
    let rotors = hubs_body_m
        .iter()
        .enumerate()
        .map(|(i, hub)| RotorMount {
            hub_body_m: hub * style.scale,
            q_body_hub: DQuat::IDENTITY,
            sweep_rad: [0.0, TAU],
            clockwise: i % 2 == 0,
            blade: 0,
            parent: None,
        })
        .collect();
    UavMesh {
        body: scaled(body, style.scale),
        rotors,
        blades: vec![scaled(rotor, style.scale)],
    }
}

/// A frame in the UAV's sizes, and its hubs [m, body].
fn built(frame: Frame, uav: &UavModel, coat: Coat, lowered: bool) -> (MeshData, Vec<DVec3>) {
    // Frames with sizes of their own are built at those, and scaled.
    let unit = (frame.diagonal_m()).map_or(1.0, |diagonal_m| uav.diagonal_m / diagonal_m);
    let hubs: Vec<DVec2> = hub_plan_m(uav).iter().map(|hub| hub / unit).collect();
    let kit = Kit {
        size_m: uav.size_m.map(|side_m| side_m / unit),
        diagonal_m: uav.diagonal_m / unit,
        hubs: &hubs,
        motor_m: motor_m(uav) / unit,
        battery_body_m: uav.battery.at_body_m / unit,
        camera_body_m: uav.camera.at_body_m / unit,
        coat,
        lowered,
    };
    let mut body = MeshData::new(DVec3::ZERO);
    let hub_z_m = match frame {
        Frame::Phantom => phantom(&mut body, &kit),
        Frame::Mavic => mavic(&mut body, &kit),
        Frame::Matrice200 => matrice_200(&mut body, &kit),
        Frame::Matrice600 => matrice_600(&mut body, &kit),
        Frame::Racer => racer(&mut body, &kit),
        Frame::Ribbed => ribbed(&mut body, &kit),
    };
    let hubs = hubs.iter().zip(hub_z_m);
    let hubs_body_m = hubs.map(|(hub, z)| hub.extend(z) * unit).collect();
    (scaled(body, unit), hubs_body_m)
}

/// A mesh about the origin, `scale` times as large.
fn scaled(mesh: MeshData, scale: f64) -> MeshData {
    if scale == 1.0 {
        return mesh;
    }
    let mut scaled = MeshData::new(DVec3::ZERO);
    scaled.append(&mesh, DAffine3::from_scale(DVec3::splat(scale)));
    scaled
}

/// What a rotor adds to the wheelbase on both sides together [m]: the m that solves
/// (l − m)² + (w − m)² = diagonal² for a quadcopter of size l × w.
pub fn overhang_m([l, w, _]: [f64; 3], diagonal_m: f64) -> f64 {
    let rest = (l + w).powi(2) - 2.0 * (l * l + w * w - diagonal_m.powi(2));
    ((l + w) - rest.max(0.0).sqrt()) / 2.0
}

/// Radius of the motors [m]: they alone lie beyond the hubs, unless the size is that with propellers.
fn motor_m(uav: &UavModel) -> f64 {
    (overhang_m(uav.size_m, uav.diagonal_m) / 2.0)
        .clamp(0.01 * uav.diagonal_m, 0.065 * uav.diagonal_m)
}

/// Hubs in plan [m, body]: front left first, counter-clockwise, none straight ahead.
fn hub_plan_m(uav: &UavModel) -> Vec<DVec2> {
    if let Shape::Own { hubs_body_m, .. } = &uav.shape {
        return hubs_body_m.iter().map(|hub| hub.truncate()).collect();
    }
    if uav.rotor_count == 4 {
        let [l, w, _] = uav.size_m;
        let beyond_m = overhang_m(uav.size_m, uav.diagonal_m);
        let (x, y) = ((l - beyond_m) / 2.0, (w - beyond_m) / 2.0);
        return [(x, y), (-x, y), (-x, -y), (x, -y)]
            .map(DVec2::from)
            .to_vec();
    }
    let n = uav.rotor_count;
    (0..n)
        .map(|i| uav.diagonal_m / 2.0 * hub_direction(i, n))
        .collect()
}

/// Direction of hub `i` of `n` that are evenly spaced [body].
pub fn hub_direction(i: usize, n: usize) -> DVec2 {
    DVec2::from_angle(PI * (2 * i + 1) as f64 / n as f64)
}

#[cfg(test)]
mod tests;
