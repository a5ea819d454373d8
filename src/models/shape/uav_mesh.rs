//! Parametric UAV bodies and propellers at the catalogue's published sizes, in body axes
//! (forward-left-up) about the centre of the rotors' square or hexagon; and what is taken for them:
//! birds, balloons, aeroplanes, leaves.
//!
//! The makers give a Phantom's, a Mavic's and the racer's size without propellers, the Matrices'
//! with them turning: hub positions and hull sizes follow from that and from the diagonal.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3};

use crate::models::flight::distractor::{
    AIRLINER_SIZE_M, BALLOON_RADIUS_M, BIRD_LENGTH_M, BIRD_SPAN_M, DistractorKind, LEAF_SIZE_M,
    LIGHT_AIRCRAFT_SIZE_M, WING_RAD,
};
use crate::models::flight::uav::{AimPart, UavKind, UavModel, model};
use crate::models::maths::rng::Stream;
use crate::models::shape::mesh::{MeshData, Paint};

/// Where a propeller, or a bird's wing, sits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotorMount {
    /// Hub [m, body].
    pub hub_body_m: DVec3,
    /// Attitude of its mesh at phase 0; it turns about its own z.
    pub q_body_hub: DQuat,
    /// Phases that it goes through, from and to [rad].
    pub sweep_rad: [f64; 2],
    /// Whether it turns clockwise seen from above; its propeller is the mirror image in y.
    pub clockwise: bool,
}

/// A UAV to draw.
#[derive(Clone, Debug)]
pub struct UavMesh {
    /// All but the propellers [m, body].
    pub body: MeshData,
    /// Hubs, in the order of the flight model's rotors.
    pub rotors: Vec<RotorMount>,
    /// The propeller of a counter-clockwise rotor about its hub, axis z [m].
    pub rotor: MeshData,
}

impl UavMesh {
    /// Where the middle of `part` of a UAV lies [m, body].
    pub fn part_body_m(&self, uav: &UavModel, part: AimPart) -> DVec3 {
        match part {
            AimPart::Body => self.centroid_body_m(),
            AimPart::Battery => uav.battery_body_m,
            AimPart::RotorHub => self.rotors.first().map_or(DVec3::ZERO, |r| r.hub_body_m),
            AimPart::Camera => uav.camera_body_m,
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
        const SWEEP_POINTS: u32 = 16;
        let point = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let blade_m = self
            .rotor
            .positions
            .iter()
            .map(|p| point(p).truncate().length())
            .fold(0.0, f64::max);
        let sweeps = self.rotors.iter().flat_map(|mount| {
            let [from, to] = mount.sweep_rad;
            (0..=SWEEP_POINTS).map(move |i| {
                let angle = from + (to - from) * f64::from(i) / f64::from(SWEEP_POINTS);
                let tip = blade_m * DVec2::from_angle(angle).extend(0.0);
                mount.hub_body_m + mount.q_body_hub * tip
            })
        });
        self.body
            .positions
            .iter()
            .map(point)
            .chain(sweeps)
            .collect()
    }
}

const BLACK: [f32; 3] = [0.02, 0.02, 0.022];
const CARBON: [f32; 3] = [0.035, 0.035, 0.038];
const DARK: [f32; 3] = [0.085, 0.09, 0.095];
const GREY: [f32; 3] = [0.3, 0.31, 0.32];
const SILVER: [f32; 3] = [0.5, 0.5, 0.51];
const WHITE: [f32; 3] = [0.78, 0.78, 0.76];
const LENS: [f32; 3] = [0.012, 0.014, 0.025];
const RED: [f32; 3] = [0.5, 0.03, 0.02];
const ORANGE: [f32; 3] = [0.55, 0.17, 0.02];
const YELLOW: [f32; 3] = [0.6, 0.4, 0.03];
const BLUE: [f32; 3] = [0.02, 0.04, 0.16];
const GREEN: [f32; 3] = [0.06, 0.22, 0.05];
const CARDBOARD: [f32; 3] = [0.36, 0.23, 0.12];

/// Paint of an airframe: linear RGB albedo of its parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Hull.
    pub shell: [f32; 3],
    /// Arms in front and behind.
    pub arms: [[f32; 3]; 2],
    /// Landing gear.
    pub gear: [f32; 3],
    /// Lower half of the motors.
    pub motor: [f32; 3],
    /// Propellers.
    pub blades: [f32; 3],
}

/// What the arms and the hull are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// As the maker of the model builds them.
    Maker,
    /// A self-built frame on the model's hubs: two plates, battery and receiver dome between deep
    /// ribbed arms that end in feet.
    Ribbed,
}

/// What a UAV carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// Nothing.
    None,
    /// A box below the hull.
    Box,
    /// A lying cylinder below the hull.
    Cylinder,
    /// A large gimbal camera below the hull.
    Camera,
    /// A parcel on a line.
    Parcel,
}

/// What a UAV lands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gear {
    /// What the frame has, lowered.
    Lowered,
    /// Nothing: retracted or taken off.
    Raised,
    /// Two skids on raked struts.
    Skids,
    /// A thin leg below each motor.
    Legs,
}

/// How one UAV of a model is painted and fitted out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Paint; None: the maker's.
    pub coat: Option<Coat>,
    /// Arms and hull.
    pub frame: Frame,
    /// What it carries.
    pub payload: Payload,
    /// What it lands on.
    pub gear: Gear,
    /// Blades of a propeller.
    pub blades: u32,
    /// Whether rings guard the propellers.
    pub guards: bool,
    /// Whether a positioning receiver stands on a mast.
    pub mast: bool,
    /// Whether two rod antennas stick out at the back.
    pub antennas: bool,
    /// Its size over the model's published one.
    pub scale: f64,
}

impl Look {
    /// The model as the catalogue publishes it.
    pub fn standard() -> Self {
        Self {
            coat: None,
            frame: Frame::Maker,
            payload: Payload::None,
            gear: Gear::Lowered,
            blades: 2,
            guards: false,
            mast: false,
            antennas: false,
            scale: 1.0,
        }
    }

    /// A look drawn from `rng`. The shares are assumptions: a third stay as the maker paints them,
    /// a third fly a self-built frame, most carry nothing; sizes lie within 8 % of the published.
    pub fn drawn(rng: &mut Stream) -> Self {
        let coat = (rng.uniform() > 0.33).then(|| Coat::drawn(rng));
        let frame = if rng.uniform() < 0.35 {
            Frame::Ribbed
        } else {
            Frame::Maker
        };
        let payload = match rng.uniform() {
            u if u < 0.64 => Payload::None,
            u if u < 0.74 => Payload::Box,
            u if u < 0.80 => Payload::Cylinder,
            u if u < 0.92 => Payload::Camera,
            _ => Payload::Parcel,
        };
        let gear = match rng.uniform() {
            u if u < 0.55 => Gear::Lowered,
            u if u < 0.75 => Gear::Raised,
            u if u < 0.88 => Gear::Skids,
            _ => Gear::Legs,
        };
        Self {
            coat,
            frame,
            payload,
            gear,
            blades: if rng.uniform() < 0.82 { 2 } else { 3 },
            guards: rng.uniform() < 0.08,
            mast: rng.uniform() < 0.2,
            antennas: rng.uniform() < 0.25,
            scale: rng.range(0.92, 1.08),
        }
    }
}

impl Coat {
    /// The maker's paint.
    fn of(kind: UavKind) -> Self {
        let plain = |shell: [f32; 3], arm: [f32; 3], gear, motor| Self {
            shell,
            arms: [arm; 2],
            gear,
            motor,
            blades: CARBON,
        };
        let trim = |c: [f32; 3]| c.map(|c| c * 0.75);
        match kind {
            UavKind::Phantom4 => plain(WHITE, WHITE, WHITE, SILVER),
            UavKind::Mavic2 => plain(DARK, trim(DARK), trim(DARK), DARK),
            UavKind::MavicAir => plain(WHITE, trim(WHITE), trim(WHITE), DARK),
            UavKind::Matrice200 | UavKind::Matrice600 => plain(DARK, CARBON, CARBON, SILVER),
            UavKind::Fpv5 => plain(CARBON, CARBON, CARBON, [0.04, 0.12, 0.42]),
        }
    }

    /// One or two colours, and propellers of their own.
    fn drawn(rng: &mut Stream) -> Self {
        const COLOURS: [[f32; 3]; 14] = [
            WHITE, WHITE, WHITE, SILVER, GREY, GREY, DARK, DARK, BLACK, CARBON, BLUE, ORANGE, RED,
            YELLOW,
        ];
        let colour = |rng: &mut Stream| {
            let at = (rng.uniform() * COLOURS.len() as f64) as usize;
            let tone = rng.range(0.8, 1.15) as f32;
            COLOURS[at.min(COLOURS.len() - 1)].map(|c| (c * tone).min(0.85))
        };
        let shell = colour(rng);
        let second = if rng.uniform() < 0.5 {
            CARBON
        } else {
            colour(rng)
        };
        let front = if rng.uniform() < 0.45 { shell } else { second };
        // Pilots of self-built frames tell front from back by the colour of the arms.
        let rear = if rng.uniform() < 0.25 {
            colour(rng)
        } else {
            front
        };
        Self {
            shell,
            arms: [front, rear],
            gear: if rng.uniform() < 0.5 { second } else { shell },
            motor: if rng.uniform() < 0.5 { SILVER } else { BLACK },
            blades: match rng.uniform() {
                u if u < 0.72 => CARBON,
                u if u < 0.82 => GREY,
                u if u < 0.9 => WHITE,
                _ => colour(rng),
            },
        }
    }

    fn arm(&self, hub: DVec2) -> Paint {
        Paint::plain(self.arms[usize::from(hub.x < 0.0)])
    }
}

/// The body, hubs and propeller of a UAV as its maker publishes it.
pub fn uav_mesh(kind: UavKind) -> UavMesh {
    uav_mesh_look(kind, &Look::standard())
}

/// The body, hubs and propeller of a UAV of a given look. Its payload and gear count to no other
/// model: the flight model knows nothing of them.
pub fn uav_mesh_look(kind: UavKind, look: &Look) -> UavMesh {
    let uav = model(kind);
    let hubs = hub_plan_m(uav);
    let coat = look.coat.unwrap_or_else(|| Coat::of(kind));
    let dress = Dress {
        coat,
        lowered: look.gear == Gear::Lowered,
    };
    let mut body = MeshData::new(DVec3::ZERO);
    let hub_z_m = match (look.frame, kind) {
        (Frame::Ribbed, _) => ribbed(&mut body, &hubs, motor_radius_m(uav), uav, &dress),
        (_, UavKind::Phantom4) => phantom(&mut body, &hubs, motor_radius_m(uav), uav, &dress),
        (_, UavKind::Mavic2 | UavKind::MavicAir) => {
            mavic(&mut body, &hubs, motor_radius_m(uav), uav, &dress)
        }
        (_, UavKind::Matrice200) => matrice_200(&mut body, &hubs, uav, &dress),
        (_, UavKind::Matrice600) => matrice_600(&mut body, &hubs, uav, &dress),
        (_, UavKind::Fpv5) => racer(&mut body, &hubs, motor_radius_m(uav), uav, &dress),
    };
    fit_out(&mut body, &hubs, &hub_z_m, uav, look, &coat);
    let mut rotor = propeller(uav.propeller_diameter_m / 2.0, look.blades, coat.blades);
    if look.scale != 1.0 {
        let scale = DAffine3::from_scale(DVec3::splat(look.scale));
        for mesh in [&mut body, &mut rotor] {
            let mut scaled = MeshData::new(DVec3::ZERO);
            scaled.append(mesh, scale);
            *mesh = scaled;
        }
    }
    let rotors = hubs
        .iter()
        .enumerate()
        .map(|(i, hub)| RotorMount {
            hub_body_m: hub.extend(hub_z_m[i]) * look.scale,
            q_body_hub: DQuat::IDENTITY,
            sweep_rad: [0.0, TAU],
            clockwise: i % 2 == 0,
        })
        .collect();
    UavMesh {
        body,
        rotors,
        rotor,
    }
}

/// What an airframe is told of its look.
struct Dress {
    coat: Coat,
    /// Whether its own landing gear is down.
    lowered: bool,
}

/// What a rotor adds to the wheelbase on both sides together [m]: the m that solves
/// (l − m)² + (w − m)² = diagonal² for a quadcopter of size l × w.
fn overhang_m(uav: &UavModel) -> f64 {
    let [l, w, _] = uav.size_m;
    let rest = (l + w).powi(2) - 2.0 * (l * l + w * w - uav.diagonal_m.powi(2));
    ((l + w) - rest.max(0.0).sqrt()) / 2.0
}

/// Radius of the motors [m] where nothing else reaches the published size.
fn motor_radius_m(uav: &UavModel) -> f64 {
    overhang_m(uav) / 2.0
}

/// Hubs in plan [m, body]: front left first, counter-clockwise, none straight ahead.
fn hub_plan_m(uav: &UavModel) -> Vec<DVec2> {
    if uav.rotor_count == 4 {
        let [l, w, _] = uav.size_m;
        let (x, y) = ((l - overhang_m(uav)) / 2.0, (w - overhang_m(uav)) / 2.0);
        return [(x, y), (-x, y), (-x, -y), (x, -y)]
            .map(DVec2::from)
            .to_vec();
    }
    let n = uav.rotor_count;
    (0..n)
        .map(|i| uav.diagonal_m / 2.0 * DVec2::from_angle(PI * (2 * i + 1) as f64 / n as f64))
        .collect()
}

// ---- Shapes ----------------------------------------------------------------------------------

/// Points of a superellipse with semi-axes along `a` and `b`, counter-clockwise seen against a × b.
fn section(center: DVec3, a: DVec3, b: DVec3, exponent: f64, sides: usize) -> Vec<DVec3> {
    let power = |x: f64| x.signum() * x.abs().powf(2.0 / exponent);
    (0..sides)
        .map(|k| {
            let (sin, cos) = (TAU * (k as f64 + 0.5) / sides as f64).sin_cos();
            center + a * power(cos) + b * power(sin)
        })
        .collect()
}

/// A rounded hull stacked upward: (z, half length, half width) per section.
fn hull_up(mesh: &mut MeshData, at: DVec2, sections: &[[f64; 3]], exponent: f64, paint: Paint) {
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|&[z, x, y]| section(at.extend(z), DVec3::X * x, DVec3::Y * y, exponent, 16))
        .collect();
    mesh.loft(&rings, paint);
}

/// A rounded hull lofted forward: (x, half width, half height, centre height) per section.
fn hull_forward(mesh: &mut MeshData, sections: &[[f64; 4]], exponent: f64, paint: Paint) {
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|&[x, y, h, z]| {
            section(
                DVec3::new(x, 0.0, z),
                DVec3::Y * y,
                DVec3::Z * h,
                exponent,
                16,
            )
        })
        .collect();
    mesh.loft(&rings, paint);
}

/// An arm of elliptic section that tapers; `size` is (half width, half height) at each end.
fn arm(mesh: &mut MeshData, from: DVec3, to: DVec3, size: [[f64; 2]; 2], paint: Paint) {
    let along = (to - from).normalize_or(DVec3::X);
    let side = DVec3::Z.cross(along).normalize_or(DVec3::Y);
    let up = along.cross(side);
    let ring = |at: DVec3, [w, h]: [f64; 2]| section(at, side * w, up * h, 2.6, 8);
    mesh.loft(&[ring(from, size[0]), ring(to, size[1])], paint);
}

fn tube(mesh: &mut MeshData, from: DVec3, to: DVec3, radius: f64, paint: Paint) {
    mesh.frustum((from, radius), (to, radius), 6, paint);
}

/// A motor bell on an arm's end.
fn motor(mesh: &mut MeshData, at: DVec2, [low, top]: [f64; 2], radius: f64, albedo: [f32; 3]) {
    let split = low + 0.45 * (top - low);
    mesh.frustum(
        (at.extend(low), radius),
        (at.extend(split), radius),
        12,
        Paint::plain(albedo),
    );
    mesh.frustum(
        (at.extend(split), radius * 0.93),
        (at.extend(top), radius * 0.8),
        12,
        Paint::plain(GREY),
    );
}

/// A box by its centre and full size.
fn block(mesh: &mut MeshData, center: DVec3, size: [f64; 3], albedo: [f32; 3]) {
    let half = DVec3::from(size) / 2.0;
    mesh.cuboid(center - half, center + half, Paint::plain(albedo));
}

/// A gimbal camera looking forward: yoke, ball and lens.
fn camera(mesh: &mut MeshData, at: DVec3, radius: f64, albedo: [f32; 3]) {
    let side = DVec3::Y * radius * 1.15;
    let top = DVec3::Z * radius * 1.5;
    tube(
        mesh,
        at + side,
        at + side + top,
        radius * 0.22,
        Paint::plain(GREY),
    );
    tube(
        mesh,
        at + side + top,
        at - side + top,
        radius * 0.25,
        Paint::plain(GREY),
    );
    mesh.icosphere(
        at,
        DVec3::new(1.0, 1.05, 0.95) * radius,
        1,
        Paint::plain(albedo),
    );
    let lens = at + DVec3::X * radius * 0.6;
    mesh.frustum(
        (lens, radius * 0.62),
        (lens + DVec3::X * radius * 0.55, radius * 0.55),
        10,
        Paint::plain(LENS),
    );
}

/// A propeller: twisted thin blades of constant pitch, 0.5 of the diameter.
fn propeller(radius: f64, blades: u32, albedo: [f32; 3]) -> MeshData {
    let mut blade = MeshData::new(DVec3::ZERO);
    let pitch_m = 0.5 * 2.0 * radius;
    let rings: Vec<Vec<DVec3>> = [
        (0.08, 0.05),
        (0.3, 0.12),
        (0.6, 0.11),
        (0.9, 0.075),
        (1.0, 0.02),
    ]
    .iter()
    .map(|&(r, chord)| {
        let beta = (pitch_m / (TAU * r * radius)).atan().min(0.6);
        // Turning from x to y, the leading edge is the one at +y, and it is the higher one.
        let along = DVec3::new(0.0, beta.cos(), beta.sin());
        let up = DVec3::X.cross(along);
        let (half, thick) = (chord * radius, (0.009 * radius).min(0.1 * chord * radius));
        section(DVec3::X * r * radius, along * half, up * thick, 2.0, 6)
    })
    .collect();
    blade.loft(&rings, Paint::plain(albedo));
    let mut rotor = MeshData::new(DVec3::ZERO);
    for k in 0..blades {
        let turn_rad = TAU * f64::from(k) / f64::from(blades);
        rotor.append(&blade, DAffine3::from_rotation_z(turn_rad));
    }
    let (low, high) = (DVec3::Z * -0.03 * radius, DVec3::Z * 0.05 * radius);
    rotor.frustum(
        (low, 0.09 * radius),
        (high, 0.06 * radius),
        8,
        Paint::plain(GREY),
    );
    rotor
}

// ---- Airframes: each returns the height of its hubs -------------------------------------------

fn phantom(
    mesh: &mut MeshData,
    hubs: &[DVec2],
    motor_m: f64,
    uav: &UavModel,
    dress: &Dress,
) -> Vec<f64> {
    let height = uav.size_m[2];
    let coat = &dress.coat;
    let gear = Paint::plain(coat.gear);
    let (top, foot) = (0.28 * height, -0.72 * height);
    #[rustfmt::skip]
    hull_up(mesh, DVec2::ZERO, &[
        [-0.034, 0.045, 0.035], [-0.026, 0.074, 0.056], [-0.006, 0.087, 0.066],
        [0.014, 0.084, 0.063], [0.032, 0.062, 0.046], [0.042, 0.03, 0.024],
    ], 2.8, Paint::plain(coat.shell));
    for &hub in hubs {
        let out = hub.normalize();
        arm(
            mesh,
            (out * 0.035).extend(0.002),
            hub.extend(0.016),
            [[0.042, 0.026], [0.019, 0.013]],
            coat.arm(hub),
        );
        mesh.frustum(
            (hub.extend(0.0), motor_m * 0.8),
            (hub.extend(0.032), motor_m),
            12,
            coat.arm(hub),
        );
        motor(mesh, hub, [0.032, top], motor_m, coat.motor);
        let lamp = if hub.x > 0.0 { RED } else { [0.25, 0.5, 0.2] };
        block(
            mesh,
            (hub * 0.93).extend(-0.002),
            [0.016, 0.012, 0.006],
            lamp,
        );
    }
    for &y in dress.sides() {
        let foot_at = |x: f64| DVec3::new(x, y * 0.083, foot + 0.006);
        for x in [-1.0, 1.0] {
            let hip = DVec3::new(x * 0.045, y * 0.05, -0.018);
            arm(
                mesh,
                hip,
                foot_at(x * 0.062),
                [[0.009, 0.007], [0.006, 0.006]],
                gear,
            );
        }
        tube(mesh, foot_at(-0.078), foot_at(0.078), 0.006, gear);
    }
    camera(mesh, uav.camera_body_m, 0.024, GREY);
    block(mesh, uav.battery_body_m, [0.05, 0.075, 0.036], SILVER);
    block(
        mesh,
        DVec3::new(0.082, 0.0, 0.0),
        [0.012, 0.06, 0.014],
        LENS,
    );
    vec![top; hubs.len()]
}

fn mavic(
    mesh: &mut MeshData,
    hubs: &[DVec2],
    motor_m: f64,
    uav: &UavModel,
    dress: &Dress,
) -> Vec<f64> {
    let [l, w, h] = uav.size_m;
    let coat = &dress.coat;
    let paint = Paint::plain(coat.shell);
    let (top, foot) = (0.42 * h, -0.58 * h);
    #[rustfmt::skip]
    hull_forward(mesh, &[
        [-0.34 * l, 0.10 * w, 0.16 * h, 0.0], [-0.31 * l, 0.17 * w, 0.29 * h, 0.0],
        [-0.05 * l, 0.19 * w, 0.36 * h, 0.02 * h], [0.2 * l, 0.175 * w, 0.32 * h, 0.04 * h],
        [0.31 * l, 0.14 * w, 0.24 * h, 0.06 * h], [0.34 * l, 0.09 * w, 0.14 * h, 0.07 * h],
    ], 3.6, paint);
    // The battery forms the rear of the back.
    block(
        mesh,
        uav.battery_body_m,
        [0.34 * l, 0.26 * w, 0.14 * h],
        coat.shell.map(|c| c * 0.85),
    );
    let mut heights = Vec::with_capacity(hubs.len());
    for &hub in hubs {
        let front = hub.x > 0.0;
        let trim = coat.arm(hub);
        // Front arms swing out at shoulder height, rear arms fold under the hull.
        let (root, z, hub_top) = if front {
            (
                DVec3::new(0.24 * l, 0.15 * w * hub.y.signum(), 0.12 * h),
                0.16 * h,
                top,
            )
        } else {
            (
                DVec3::new(-0.2 * l, 0.15 * w * hub.y.signum(), -0.12 * h),
                -0.04 * h,
                0.22 * h,
            )
        };
        arm(
            mesh,
            root,
            hub.extend(z),
            [[0.05 * l, 0.15 * h], [0.032 * l, 0.1 * h]],
            trim,
        );
        mesh.frustum(
            (hub.extend(z - 0.14 * h), motor_m * 0.9),
            (hub.extend(z + 0.1 * h), motor_m),
            12,
            trim,
        );
        motor(mesh, hub, [z + 0.1 * h, hub_top], motor_m, coat.motor);
        let leg = if front { foot } else { -0.5 * h };
        if dress.lowered {
            arm(
                mesh,
                hub.extend(z),
                hub.extend(leg),
                [[0.022 * l, 0.03 * l], [0.012 * l, 0.018 * l]],
                Paint::plain(coat.gear),
            );
        }
        heights.push(hub_top);
    }
    camera(mesh, uav.camera_body_m, 0.2 * h, DARK);
    block(
        mesh,
        DVec3::new(0.335 * l, 0.0, 0.14 * h),
        [0.03 * l, 0.2 * w, 0.1 * h],
        LENS,
    );
    block(
        mesh,
        DVec3::new(-0.02 * l, 0.0, -0.34 * h),
        [0.25 * l, 0.2 * w, 0.06 * h],
        BLACK,
    );
    heights
}

fn matrice_200(mesh: &mut MeshData, hubs: &[DVec2], uav: &UavModel, dress: &Dress) -> Vec<f64> {
    let height = uav.size_m[2];
    let coat = &dress.coat;
    let dark = Paint::plain(coat.shell);
    let carbon = Paint::plain(CARBON);
    let gear = Paint::plain(coat.gear);
    let (top, foot) = (0.27 * height, -0.73 * height);
    #[rustfmt::skip]
    hull_forward(mesh, &[
        [-0.19, 0.05, 0.032, 0.01], [-0.17, 0.075, 0.05, 0.01], [-0.04, 0.085, 0.062, 0.015],
        [0.1, 0.075, 0.056, 0.012], [0.17, 0.055, 0.04, 0.0], [0.2, 0.03, 0.022, -0.005],
    ], 3.2, dark);
    for y in [-1.0, 1.0] {
        // Twin batteries at the back.
        block(
            mesh,
            DVec3::new(1.0, y, 1.0) * uav.battery_body_m,
            [0.09, 0.062, 0.07],
            GREY,
        );
        if dress.lowered {
            let knee = DVec3::new(-0.02, y * 0.13, foot + 0.012);
            let hip = DVec3::new(-0.02, y * 0.06, -0.03);
            skid(
                mesh,
                [hip, knee],
                [0.011, 0.008, 0.012],
                [0.15, 0.13, 0.03],
                gear,
            );
        }
        // Antennas of the positioning receivers.
        let mast = DVec3::new(-0.07, y * 0.05, 0.05);
        tube(mesh, mast, mast + DVec3::Z * (top - 0.056), 0.006, carbon);
        mesh.frustum(
            (DVec3::new(mast.x, mast.y, top - 0.014), 0.022),
            (DVec3::new(mast.x, mast.y, top), 0.018),
            10,
            dark,
        );
    }
    for &hub in hubs {
        let out = hub.normalize();
        arm(
            mesh,
            (out * 0.07).extend(0.012),
            (out * 0.14).extend(0.02),
            [[0.032, 0.03], [0.02, 0.02]],
            dark,
        );
        tube(
            mesh,
            (out * 0.12).extend(0.018),
            hub.extend(0.03),
            0.0145,
            coat.arm(hub),
        );
        mesh.frustum(
            (hub.extend(0.008), 0.024),
            (hub.extend(0.046), 0.028),
            12,
            dark,
        );
        motor(mesh, hub, [0.046, 0.078], 0.029, coat.motor);
        let lamp = if hub.x > 0.0 { RED } else { [0.1, 0.45, 0.1] };
        block(mesh, hub.extend(0.004), [0.02, 0.02, 0.01], lamp);
    }
    camera(mesh, uav.camera_body_m, 0.042, DARK);
    mesh.frustum(
        (DVec3::new(0.15, 0.0, -0.058), 0.03),
        (DVec3::new(0.15, 0.0, -0.03), 0.036),
        10,
        carbon,
    );
    block(mesh, DVec3::new(0.19, 0.0, 0.02), [0.03, 0.06, 0.018], LENS);
    vec![0.078; hubs.len()]
}

fn matrice_600(mesh: &mut MeshData, hubs: &[DVec2], uav: &UavModel, dress: &Dress) -> Vec<f64> {
    let height = uav.size_m[2];
    let coat = &dress.coat;
    let dark = Paint::plain(coat.shell);
    let carbon = Paint::plain(CARBON);
    let (top, foot) = (0.25 * height, -0.75 * height);
    #[rustfmt::skip]
    hull_up(mesh, DVec2::ZERO, &[
        [-0.05, 0.11, 0.11], [-0.03, 0.17, 0.17], [0.03, 0.175, 0.175], [0.055, 0.14, 0.14],
        [0.09, 0.1, 0.1], [0.108, 0.05, 0.05],
    ], 2.0, dark);
    for (i, &hub) in hubs.iter().enumerate() {
        let out = hub.normalize();
        tube(
            mesh,
            (out * 0.13).extend(0.005),
            hub.extend(0.02),
            0.0135,
            coat.arm(hub),
        );
        // The folding joint, and a battery between each pair of arms.
        tube(
            mesh,
            (out * 0.17).extend(0.005),
            (out * 0.25).extend(0.008),
            0.021,
            dark,
        );
        let between = DVec2::from_angle(PI / 6.0 + TAU * i as f64 / 6.0 + PI / 6.0);
        let mut battery = MeshData::new(DVec3::ZERO);
        block(&mut battery, uav.battery_body_m, [0.07, 0.085, 0.085], GREY);
        mesh.append(&battery, DAffine3::from_rotation_z(between.to_angle()));
        motor(
            mesh,
            hub,
            [-0.008, 0.068],
            0.038,
            if hub.x > 0.1 { RED } else { coat.motor },
        );
    }
    // Three receivers on masts.
    for k in 0..3 {
        let at = DVec2::from_angle(PI + TAU * f64::from(k) / 3.0) * 0.11;
        tube(mesh, at.extend(0.05), at.extend(top - 0.012), 0.004, carbon);
        mesh.frustum(
            (at.extend(top - 0.018), 0.03),
            (at.extend(top), 0.026),
            12,
            dark,
        );
    }
    // Retractable gear, lowered.
    for &y in dress.sides() {
        let knee = DVec3::new(0.0, y * 0.33, foot + 0.012);
        let hip = DVec3::new(0.0, y * 0.14, -0.035);
        let gear = Paint::plain(coat.gear);
        skid(
            mesh,
            [hip, knee],
            [0.0125, 0.01, 0.012],
            [0.24, 0.2, 0.04],
            gear,
        );
    }
    // A three-axis gimbal with a cinema camera.
    tube(
        mesh,
        DVec3::new(0.0, 0.0, -0.05),
        DVec3::new(0.0, 0.0, -0.14),
        0.02,
        carbon,
    );
    tube(
        mesh,
        DVec3::new(-0.1, 0.0, -0.14),
        DVec3::new(0.02, 0.0, -0.14),
        0.016,
        carbon,
    );
    tube(
        mesh,
        DVec3::new(-0.1, 0.0, -0.14),
        DVec3::new(-0.1, 0.0, -0.25),
        0.016,
        carbon,
    );
    block(mesh, uav.camera_body_m, [0.15, 0.085, 0.1], BLACK);
    let lens = DVec3::new(0.075, 0.0, -0.25);
    mesh.frustum(
        (lens, 0.038),
        (lens + DVec3::X * 0.07, 0.042),
        12,
        Paint::plain(LENS),
    );
    vec![0.068; hubs.len()]
}

fn racer(
    mesh: &mut MeshData,
    hubs: &[DVec2],
    motor_m: f64,
    uav: &UavModel,
    dress: &Dress,
) -> Vec<f64> {
    let height = uav.size_m[2];
    let coat = &dress.coat;
    let low = -0.3 * height;
    let top = low + height;
    let deck = low + 0.005; // [m], the plate's thickness
    for &hub in hubs {
        let axis = hub.normalize();
        let mut beam = MeshData::new(DVec3::ZERO);
        let length = hub.length() + 0.004;
        beam.cuboid(
            DVec3::new(0.0, -0.0065, low),
            DVec3::new(length, 0.0065, deck),
            coat.arm(hub),
        );
        mesh.append(&beam, DAffine3::from_rotation_z(axis.to_angle()));
        motor(mesh, hub, [deck, deck + 0.02], motor_m, coat.motor);
        let controller = (axis * hub.length() * 0.55).extend(deck + 0.0025);
        block(mesh, controller, [0.022, 0.014, 0.005], [0.02, 0.1, 0.05]);
    }
    block(
        mesh,
        DVec3::new(0.0, 0.0, deck),
        [0.13, 0.038, 0.004],
        coat.shell,
    );
    let upper = deck + 0.022;
    block(
        mesh,
        DVec3::new(-0.005, 0.0, upper),
        [0.12, 0.032, 0.003],
        coat.shell,
    );
    for x in [-0.055, 0.045] {
        for y in [-0.013, 0.013] {
            let at = DVec2::new(x, y);
            tube(
                mesh,
                at.extend(deck),
                at.extend(upper),
                0.0025,
                Paint::plain(RED),
            );
        }
    }
    block(
        mesh,
        DVec3::new(-0.005, 0.0, deck + 0.01),
        [0.036, 0.028, 0.012],
        [0.02, 0.1, 0.05],
    );
    // The battery is strapped on top, bare.
    let (floor, ceiling) = (upper + 0.0015, top);
    let middle = (floor + ceiling) / 2.0;
    block(
        mesh,
        uav.battery_body_m,
        [0.076, 0.036, ceiling - floor - 0.001],
        [0.05, 0.06, 0.2],
    );
    block(
        mesh,
        DVec3::new(-0.005, 0.0, middle),
        [0.018, 0.0375, ceiling - floor],
        BLACK,
    );
    block(
        mesh,
        DVec3::new(-0.046, 0.0, middle),
        [0.008, 0.02, 0.012],
        [0.5, 0.35, 0.02],
    );
    // The camera between its side plates, tilted up.
    for y in [-0.012, 0.012] {
        block(
            mesh,
            DVec3::new(0.062, y, deck + 0.011),
            [0.022, 0.002, 0.022],
            RED,
        );
    }
    let eye = uav.camera_body_m;
    mesh.icosphere(eye, DVec3::splat(0.0105), 1, Paint::plain(BLACK));
    mesh.frustum(
        (eye, 0.007),
        (eye + DVec3::new(0.013, 0.0, 0.007), 0.006),
        8,
        Paint::plain(LENS),
    );
    tube(
        mesh,
        DVec3::new(-0.06, 0.0, upper),
        DVec3::new(-0.085, 0.0, top - 0.006),
        0.002,
        Paint::plain(BLACK),
    );
    vec![deck + 0.02; hubs.len()]
}

/// A self-built frame on the model's hubs, as the 450 and 550 mm kits are: sizes in units of a 450 mm
/// diagonal, of which one with slender arms stays short.
fn ribbed(
    mesh: &mut MeshData,
    hubs: &[DVec2],
    motor_m: f64,
    uav: &UavModel,
    dress: &Dress,
) -> Vec<f64> {
    let coat = &dress.coat;
    let unit = uav.diagonal_m / 0.45;
    let motor_m = motor_m.clamp(0.3 * 0.014 * unit, 0.014 * unit);
    let dark = Paint::plain(BLACK);
    for z in [-0.022, 0.020] {
        hull_up(
            mesh,
            DVec2::ZERO,
            &[
                [z * unit, 0.062 * unit, 0.055 * unit],
                [(z + 0.004) * unit, 0.062 * unit, 0.055 * unit],
            ],
            3.0,
            dark,
        );
    }
    // Battery between or on the plates, controller and receiver dome above.
    block(
        mesh,
        DVec3::new(0.0, 0.0, 0.0),
        [0.12 * unit, 0.042 * unit, 0.036 * unit],
        DARK,
    );
    #[rustfmt::skip]
    hull_up(mesh, DVec2::ZERO, &[
        [0.024 * unit, 0.05 * unit, 0.042 * unit], [0.045 * unit, 0.044 * unit, 0.036 * unit],
        [0.058 * unit, 0.022 * unit, 0.018 * unit],
    ], 2.4, Paint::plain(coat.shell));
    let top = 0.046 * unit;
    for &hub in hubs {
        let out = hub.normalize();
        let paint = coat.arm(hub);
        let (root, tip) = (out * 0.045 * unit, hub);
        let slim = |w: f64, h: f64| [w * unit, h * unit];
        // A flat top rail, a lower one that sweeps up to it, and the end that goes down to a foot.
        arm(
            mesh,
            root.extend(0.014 * unit),
            tip.extend(0.014 * unit),
            [slim(0.017, 0.006), slim(0.013, 0.006)],
            paint,
        );
        arm(
            mesh,
            root.extend(-0.018 * unit),
            tip.extend(-0.008 * unit),
            [slim(0.008, 0.006), slim(0.008, 0.006)],
            paint,
        );
        arm(
            mesh,
            root.lerp(tip, 0.5).extend(-0.014 * unit),
            root.lerp(tip, 0.62).extend(0.012 * unit),
            [slim(0.005, 0.006), slim(0.005, 0.006)],
            paint,
        );
        mesh.frustum(
            (tip.extend(-0.02 * unit), 0.011 * unit),
            (tip.extend(0.018 * unit), motor_m.max(0.012 * unit)),
            8,
            paint,
        );
        if dress.lowered {
            let foot = (tip - out * 0.004 * unit).extend(-0.075 * unit);
            arm(
                mesh,
                tip.extend(-0.016 * unit),
                foot,
                [slim(0.011, 0.008), slim(0.007, 0.006)],
                Paint::plain(coat.gear),
            );
        }
        motor(mesh, hub, [0.018 * unit, top], motor_m, coat.motor);
        let controller = root.lerp(tip, 0.45).extend(0.0);
        block(
            mesh,
            controller,
            [0.024 * unit, 0.024 * unit, 0.01 * unit],
            BLACK,
        );
    }
    vec![top; hubs.len()]
}

impl Dress {
    /// The sides on which the frame's own skids hang: both or none.
    fn sides(&self) -> &'static [f64] {
        if self.lowered { &[-1.0, 1.0] } else { &[] }
    }
}

/// A strut from hip to knee and a rail along x with two soft pads: radii of strut, rail and pads;
/// half length of the rail, place and half length of the pads [m].
fn skid(
    mesh: &mut MeshData,
    [hip, knee]: [DVec3; 2],
    [strut_m, rail_m, pad_radius_m]: [f64; 3],
    [half_m, pad_at_m, pad_m]: [f64; 3],
    paint: Paint,
) {
    tube(mesh, hip, knee, strut_m, paint);
    let x = DVec3::X;
    tube(mesh, knee - x * half_m, knee + x * half_m, rail_m, paint);
    for at in [-pad_at_m, pad_at_m] {
        let (from, to) = (knee + x * (at - pad_m), knee + x * (at + pad_m));
        tube(mesh, from, to, pad_radius_m, Paint::plain(BLACK));
    }
}

/// Gear, payload, guards, mast and antennas that the look adds to an airframe.
fn fit_out(
    mesh: &mut MeshData,
    hubs: &[DVec2],
    hub_z_m: &[f64],
    uav: &UavModel,
    look: &Look,
    coat: &Coat,
) {
    if *look == Look::standard() {
        return;
    }
    let unit = uav.diagonal_m / 0.35;
    // Bottom and top of the hull, cameras included: what lies near the middle.
    let (floor, roof) = mesh
        .positions
        .iter()
        .map(|p| p.map(f64::from))
        .filter(|p| p[0].hypot(p[1]) < 0.2 * uav.diagonal_m)
        .fold((0.0, 0.0), |(low, high): (f64, f64), p| {
            (low.min(p[2]), high.max(p[2]))
        });
    let gear = Paint::plain(coat.gear);
    let low = hub_z_m.iter().copied().fold(0.0, f64::min);
    match look.gear {
        Gear::Lowered | Gear::Raised => {}
        Gear::Skids => {
            for y in [-1.0, 1.0] {
                let hip = DVec3::new(0.0, y * 0.04, -0.01) * unit;
                let knee = DVec3::new(
                    0.0,
                    y * 0.085 * unit,
                    (floor - 0.02 * unit).min(-0.1 * unit),
                );
                let thin = [0.007, 0.0055, 0.008].map(|r| r * unit);
                skid(
                    mesh,
                    [hip, knee],
                    thin,
                    [0.09, 0.07, 0.015].map(|x| x * unit),
                    gear,
                );
            }
        }
        Gear::Legs => {
            for &hub in hubs {
                let from = (hub * 0.9).extend(low);
                let to = (hub * 0.93).extend((low - 0.12 * unit).min(-0.07 * unit));
                tube(mesh, from, to, 0.005 * unit, gear);
            }
        }
    }
    let hang = |depth: f64| DVec3::Z * (floor - depth * unit);
    match look.payload {
        Payload::None => {}
        Payload::Box => block(
            mesh,
            hang(0.028),
            [0.12, 0.09, 0.06].map(|x| x * unit),
            CARDBOARD,
        ),
        Payload::Cylinder => mesh.frustum(
            (hang(0.024) - DVec3::X * 0.085 * unit, 0.026 * unit),
            (hang(0.024) + DVec3::X * 0.085 * unit, 0.026 * unit),
            10,
            Paint::plain(if coat.shell == WHITE { GREEN } else { SILVER }),
        ),
        Payload::Camera => {
            tube(
                mesh,
                hang(-0.012),
                hang(0.02),
                0.012 * unit,
                Paint::plain(GREY),
            );
            camera(
                mesh,
                hang(0.048) + DVec3::X * 0.02 * unit,
                0.026 * unit,
                BLACK,
            );
        }
        Payload::Parcel => {
            tube(
                mesh,
                hang(-0.012),
                hang(0.2),
                0.0018 * unit,
                Paint::plain(GREY),
            );
            block(
                mesh,
                hang(0.235),
                [0.1, 0.08, 0.075].map(|x| x * unit),
                CARDBOARD,
            );
        }
    }
    if look.guards {
        let reach = 1.07 * uav.propeller_diameter_m / 2.0;
        let bar = Paint::plain(coat.gear);
        const CORNERS: usize = 14;
        for (&hub, &z) in hubs.iter().zip(hub_z_m) {
            let at = |k: usize| {
                let out = DVec2::from_angle(TAU * k as f64 / CORNERS as f64);
                (hub + out * reach).extend(z)
            };
            for k in 0..CORNERS {
                mesh.frustum((at(k), 0.004 * unit), (at(k + 1), 0.004 * unit), 4, bar);
                if k % 5 == 0 {
                    let below = hub.extend(z - 0.02 * unit);
                    mesh.frustum((below, 0.0035 * unit), (at(k), 0.0035 * unit), 4, bar);
                }
            }
        }
    }
    let back = |y: f64| DVec3::new(-0.05 * unit, y * unit, roof - 0.012 * unit);
    if look.mast {
        let tip = back(0.0) + DVec3::Z * 0.085 * unit;
        tube(mesh, back(0.0), tip, 0.003 * unit, Paint::plain(CARBON));
        mesh.frustum(
            (tip, 0.028 * unit),
            (tip + DVec3::Z * 0.01 * unit, 0.02 * unit),
            10,
            Paint::plain(coat.shell),
        );
    }
    if look.antennas {
        for y in [-0.025, 0.025] {
            let tip = back(y) + DVec3::new(-0.05, y, 0.06) * unit;
            tube(mesh, back(y), tip, 0.0025 * unit, Paint::plain(BLACK));
        }
    }
}

// ---- Distractors ------------------------------------------------------------------------------

/// Body and wings of a distractor; a bird's wings are its rotors.
pub fn distractor_mesh(kind: DistractorKind) -> UavMesh {
    match kind {
        DistractorKind::Bird => bird(&GULL),
        DistractorKind::Balloon => balloon(BALLOON_RADIUS_M, RED),
        DistractorKind::Aeroplane => solid(airliner(AIRLINER_SIZE_M, WHITE, BLUE)),
        DistractorKind::Leaf => solid(leaf(LEAF_SIZE_M, [0.16, 0.1, 0.03])),
    }
}

/// A distractor of drawn species, size and colour: gulls, crows and pigeons; balloons; airliners of
/// 35 to 70 m and light aircraft; leaves and scraps of 5 to 35 cm.
pub fn distractor_mesh_drawn(kind: DistractorKind, rng: &mut Stream) -> UavMesh {
    let colours = [WHITE, WHITE, WHITE, SILVER, GREY, BLUE, RED, ORANGE, GREEN];
    let pick = |rng: &mut Stream, of: &[[f32; 3]]| {
        of[((rng.uniform() * of.len() as f64) as usize).min(of.len() - 1)]
    };
    match kind {
        DistractorKind::Bird => {
            let species = match rng.uniform() {
                u if u < 0.4 => GULL,
                u if u < 0.75 => CROW,
                _ => PIGEON,
            };
            let size = rng.range(0.88, 1.12);
            let tone = rng.range(0.7, 1.2) as f32;
            bird(&Bird {
                length_m: species.length_m * size,
                span_m: species.span_m * size,
                tones: species.tones.map(|c| c.map(|c| (c * tone).min(0.85))),
                ..species
            })
        }
        DistractorKind::Balloon => {
            let colour = pick(rng, &[RED, BLUE, YELLOW, WHITE, GREEN, ORANGE, SILVER]);
            balloon(rng.range(0.12, 0.5), colour)
        }
        DistractorKind::Aeroplane => {
            let [shell, tail] = [pick(rng, &colours[..5]), pick(rng, &colours)];
            if rng.uniform() < 0.6 {
                let size = rng.range(35.0, 70.0) / AIRLINER_SIZE_M[0];
                solid(airliner(AIRLINER_SIZE_M.map(|x| x * size), shell, tail))
            } else {
                let size = rng.range(0.85, 1.15);
                solid(light_aircraft(
                    LIGHT_AIRCRAFT_SIZE_M.map(|x| x * size),
                    shell,
                    tail,
                ))
            }
        }
        DistractorKind::Leaf => {
            let length_m = 0.05 * 7.0_f64.powf(rng.uniform());
            let width_m = length_m * rng.range(0.45, 0.9);
            let autumn = [[0.16, 0.1, 0.03], [0.1, 0.06, 0.03], [0.28, 0.2, 0.04]];
            let albedo = if rng.uniform() < 0.6 {
                pick(rng, &autumn)
            } else {
                pick(rng, &colours)
            };
            solid(leaf([length_m, width_m, 0.2 * length_m], albedo))
        }
    }
}

/// A body without moving parts.
fn solid(body: MeshData) -> UavMesh {
    UavMesh {
        body,
        rotors: Vec::new(),
        rotor: MeshData::new(DVec3::ZERO),
    }
}

/// A species of bird.
#[derive(Clone, Copy, Debug)]
struct Bird {
    length_m: f64,
    span_m: f64,
    /// Width of body and wings over the gull's.
    breadth: f64,
    /// Body, wings, wing tips and bill.
    tones: [[f32; 3]; 4],
}

const GULL: Bird = Bird {
    length_m: BIRD_LENGTH_M,
    span_m: BIRD_SPAN_M,
    breadth: 1.0,
    tones: [WHITE, GREY, BLACK, YELLOW],
};
// Carrion crow and feral pigeon: length and span of the species' handbook ranges (recalled).
const CROW: Bird = Bird {
    length_m: 0.47,
    span_m: 0.92,
    breadth: 1.3,
    tones: [BLACK, BLACK, BLACK, BLACK],
};
const PIGEON: Bird = Bird {
    length_m: 0.33,
    span_m: 0.67,
    breadth: 1.25,
    tones: [GREY, GREY, DARK, DARK],
};

/// A bird: body, bill, tail and two wings, alike fore and aft.
fn bird(species: &Bird) -> UavMesh {
    // The gull's own measures, in units of its length and span.
    let (l, breadth) = (species.length_m / BIRD_LENGTH_M, species.breadth);
    let b = l * breadth;
    let [tone, feather, tip_tone, bill] = species.tones;
    let mut body = MeshData::new(DVec3::ZERO);
    #[rustfmt::skip]
    let hull = [
        [-0.30, 0.07, 0.006, 0.01], [-0.17, 0.035, 0.03, 0.0], [-0.05, 0.07, 0.065, 0.0],
        [0.09, 0.07, 0.065, 0.0], [0.17, 0.04, 0.042, 0.01], [0.22, 0.045, 0.045, 0.015],
        [0.25, 0.025, 0.025, 0.015],
    ].map(|[x, w, h, z]| [x * l, w * b, h * b, z * l]);
    hull_forward(&mut body, &hull, 2.0, Paint::plain(tone));
    body.frustum(
        (DVec3::new(0.245, 0.0, 0.012) * l, 0.013 * l),
        (DVec3::new(0.30, 0.0, 0.004) * l, 0.004 * l),
        6,
        Paint::plain(bill),
    );
    let shoulder_m = 0.04 * l; // to either side
    let length_m = species.span_m / 2.0 - shoulder_m;
    let mut wing = MeshData::new(DVec3::ZERO);
    // Along x to the tip, thickness along y, chord along z.
    let ring = |r: f64, chord_m: f64| {
        let half = 0.5 * chord_m * b;
        section(
            DVec3::X * r * length_m,
            DVec3::Y * (0.08 * half),
            DVec3::Z * half,
            2.0,
            8,
        )
    };
    let feathers = [(0.0, 0.17), (0.25, 0.21), (0.5, 0.18), (0.8, 0.10)];
    wing.loft(&feathers.map(|(r, c)| ring(r, c)), Paint::plain(feather));
    let tip = [(0.8, 0.10), (0.93, 0.05), (1.0, 0.01)];
    wing.loft(&tip.map(|(r, c)| ring(r, c)), Paint::plain(tip_tone));
    // The hinge lies along the body: the wing's x points outward, a growing phase lifts it.
    let wings = [1.0, -1.0].map(|side| RotorMount {
        hub_body_m: DVec3::new(0.06 * l, side * shoulder_m, 0.035 * l),
        q_body_hub: DQuat::from_mat3(&glam::DMat3::from_cols(
            side * DVec3::Y,
            DVec3::Z,
            side * DVec3::X,
        )),
        sweep_rad: [WING_RAD[0] - WING_RAD[1], WING_RAD[0] + WING_RAD[1]],
        clockwise: false,
    });
    UavMesh {
        body,
        rotors: wings.into(),
        rotor: wing,
    }
}

/// A latex balloon with its knot.
fn balloon(radius_m: f64, albedo: [f32; 3]) -> UavMesh {
    let mut body = MeshData::new(DVec3::ZERO);
    let paint = Paint::plain(albedo);
    body.icosphere(DVec3::ZERO, DVec3::splat(radius_m), 3, paint);
    body.frustum(
        (DVec3::Z * -(radius_m + 0.04), 0.03),
        (DVec3::Z * -(radius_m - 0.01), 0.012),
        8,
        paint,
    );
    solid(body)
}

/// A wing or fin: thin elliptic sections (leading edge, chord) from root to tip.
fn wing(mesh: &mut MeshData, ends: [(DVec3, f64); 2], thick: f64, up: DVec3, paint: Paint) {
    let ring = |(lead, chord): (DVec3, f64)| {
        let half = DVec3::X * chord / 2.0;
        section(lead - half, half, up * thick * chord / 2.0, 2.0, 8)
    };
    // Rings run counter-clockwise about the direction from root to tip.
    let along = ends[1].0 - ends[0].0;
    let mut rings = ends.map(ring);
    if DVec3::X.cross(up).dot(along) < 0.0 {
        for ring in &mut rings {
            ring.reverse();
        }
    }
    mesh.loft(&rings, paint);
}

/// A twin-jet airliner of length, span and height `size_m` [m], centred on its box's plan.
fn airliner(size_m: [f64; 3], shell: [f32; 3], tail: [f32; 3]) -> MeshData {
    let [l, span, h] = size_m;
    let mut mesh = MeshData::new(DVec3::ZERO);
    let r = 0.053 * l;
    let (white, fin) = (Paint::plain(shell), Paint::plain(tail));
    #[rustfmt::skip]
    hull_forward(&mut mesh, &[
        [-0.5 * l, 0.1 * r, 0.15 * r, 0.55 * r], [-0.4 * l, 0.55 * r, 0.6 * r, 0.35 * r],
        [-0.2 * l, r, r, 0.0], [0.38 * l, r, r, 0.0], [0.45 * l, 0.75 * r, 0.75 * r, -0.1 * r],
        [0.5 * l, 0.12 * r, 0.12 * r, -0.25 * r],
    ], 2.0, white);
    let silver = Paint::plain(SILVER);
    for y in [-1.0, 1.0] {
        let at = |x: f64, side: f64, z: f64| DVec3::new(x * l, y * side, z);
        wing(
            &mut mesh,
            [
                (at(0.12, 0.0, -0.5 * r), 0.2 * l),
                (at(-0.12, span / 2.0, 0.035 * span - 0.5 * r), 0.045 * l),
            ],
            0.11,
            DVec3::Z,
            silver,
        );
        wing(
            &mut mesh,
            [
                (at(-0.39, 0.0, 0.4 * r), 0.1 * l),
                (at(-0.46, 0.17 * span, 0.6 * r), 0.035 * l),
            ],
            0.1,
            DVec3::Z,
            silver,
        );
        let engine = at(0.075, 0.16 * span, -1.15 * r);
        mesh.frustum(
            (engine - DVec3::X * 0.1 * l, 0.38 * r),
            (engine, 0.55 * r),
            12,
            fin,
        );
    }
    let top = h - 2.2 * r;
    wing(
        &mut mesh,
        [
            (DVec3::new(-0.35 * l, 0.0, 0.5 * r), 0.15 * l),
            (DVec3::new(-0.455 * l, 0.0, top), 0.045 * l),
        ],
        0.1,
        DVec3::Y,
        fin,
    );
    mesh
}

/// A high-wing single with fixed gear of length, span and height `size_m` [m].
fn light_aircraft(size_m: [f64; 3], shell: [f32; 3], tail: [f32; 3]) -> MeshData {
    let [l, span, h] = size_m;
    let mut mesh = MeshData::new(DVec3::ZERO);
    let (white, trim) = (Paint::plain(shell), Paint::plain(tail));
    #[rustfmt::skip]
    hull_forward(&mut mesh, &[
        [-0.47 * l, 0.008 * l, 0.02 * l, 0.02 * l], [-0.2 * l, 0.04 * l, 0.05 * l, 0.01 * l],
        [0.02 * l, 0.065 * l, 0.085 * l, 0.02 * l], [0.22 * l, 0.065 * l, 0.08 * l, 0.015 * l],
        [0.3 * l, 0.06 * l, 0.055 * l, -0.015 * l], [0.46 * l, 0.045 * l, 0.045 * l, -0.02 * l],
    ], 2.8, white);
    let (roof, belly) = (0.1 * l, -0.065 * l);
    for y in [-1.0, 1.0] {
        let at = |x: f64, side: f64, z: f64| DVec3::new(x * l, y * side, z);
        wing(
            &mut mesh,
            [
                (at(0.23, 0.0, roof), 0.19 * l),
                (at(0.2, span / 2.0, roof + 0.015 * span), 0.14 * l),
            ],
            0.12,
            DVec3::Z,
            white,
        );
        wing(
            &mut mesh,
            [
                (at(-0.34, 0.0, 0.02 * l), 0.13 * l),
                (at(-0.37, 0.16 * span, 0.02 * l), 0.09 * l),
            ],
            0.1,
            DVec3::Z,
            trim,
        );
        let strut = at(0.12, 0.06 * l, belly);
        tube(
            &mut mesh,
            strut,
            at(0.13, 0.26 * span, roof),
            0.006 * l,
            white,
        );
        let wheel = at(0.09, 0.15 * l, 0.02 * l - 0.62 * h);
        tube(
            &mut mesh,
            at(0.09, 0.05 * l, belly),
            wheel,
            0.007 * l,
            white,
        );
        block(&mut mesh, wheel, [0.07 * l, 0.02 * l, 0.05 * l], BLACK);
    }
    let nose = DVec3::new(0.36 * l, 0.0, -0.05 * l);
    let wheel = nose - DVec3::Z * 0.12 * l;
    tube(&mut mesh, nose, wheel, 0.006 * l, white);
    block(&mut mesh, wheel, [0.06 * l, 0.02 * l, 0.05 * l], BLACK);
    // A blade in any position stands for the propeller.
    let hub = DVec3::new(0.48 * l, 0.0, -0.02 * l);
    block(&mut mesh, hub, [0.04 * l, 0.03 * l, 0.03 * l], tail);
    block(&mut mesh, hub, [0.004 * l, 0.012 * l, 0.23 * l], DARK);
    wing(
        &mut mesh,
        [
            (DVec3::new(-0.3 * l, 0.0, 0.03 * l), 0.16 * l),
            (DVec3::new(-0.42 * l, 0.0, 0.4 * h + 0.02 * l), 0.08 * l),
        ],
        0.1,
        DVec3::Y,
        trim,
    );
    mesh
}

/// A bent thin plate, pointed at both ends, of length, width and bend `size_m` [m].
fn leaf(size_m: [f64; 3], albedo: [f32; 3]) -> MeshData {
    let [length, width, bend] = size_m;
    let mut mesh = MeshData::new(DVec3::ZERO);
    let rings: Vec<Vec<DVec3>> = [
        (-0.5, 0.06),
        (-0.3, 0.7),
        (-0.05, 1.0),
        (0.25, 0.75),
        (0.5, 0.06),
    ]
    .iter()
    .map(|&(x, w): &(f64, f64)| {
        section(
            DVec3::new(x * length, 0.0, bend * (4.0 * x * x - 0.5)),
            // Six corners at 30 degrees off the axis reach its cosine.
            DVec3::Y * w * width / 3.0_f64.sqrt(),
            DVec3::Z * 0.01 * length,
            2.0,
            6,
        )
    })
    .collect();
    mesh.loft(&rings, Paint::plain(albedo));
    mesh
}

#[cfg(test)]
mod tests;
