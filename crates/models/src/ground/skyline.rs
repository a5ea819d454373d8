//! The highest solid thing in every azimuth, seen from a place that stays: above it there is only sky.

use crate::maths::kinematics::los_to_az_el;
use crate::optics::camera::{Pinhole, PixelRect};
use crate::shape::mesh::MeshData;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Azimuths that are told apart: 1.5 mrad each.
const BINS: usize = 4096;
/// How far the eye may move from the place [m].
const REACH_M: f64 = 0.3;
/// Allowance for what lies between samples, and for f32 vertices [rad].
const MARGIN_RAD: f64 = 1e-3;
/// An edge nearer than this in the plan may lie in any azimuth [m].
const OVERHEAD_M: f64 = 1.0;

/// The elevation below which something solid may stand, over the azimuth.
#[derive(Clone, Debug)]
pub struct Skyline {
    r_eye_enu_m: DVec3,
    /// Its tangent for each step of the azimuth from north over east.
    rise: Vec<f64>,
    /// The direction in the plan (east, north) in which each step begins.
    begins: Vec<DVec2>,
}

impl Skyline {
    /// The skyline of `meshes` (enu) from `r_eye_enu_m`.
    pub fn new(meshes: &[MeshData], r_eye_enu_m: DVec3) -> Self {
        let begin = |k: usize| DVec2::from((k as f64 / BINS as f64 * TAU).sin_cos());
        let mut skyline = Self {
            r_eye_enu_m,
            rise: vec![f64::NEG_INFINITY; BINS],
            begins: (0..BINS).map(begin).collect(),
        };
        for mesh in meshes {
            let origin_m = mesh.origin_enu_m - r_eye_enu_m;
            let at = |i: u32| origin_m + DVec3::from(mesh.positions[i as usize].map(f64::from));
            for triangle in mesh.indices.as_chunks::<3>().0 {
                skyline.raise_triangle(triangle.map(at));
            }
        }
        skyline
    }

    /// Lets one more triangle [m, enu] stand before the sky.
    pub fn add(&mut self, corners_enu_m: [DVec3; 3]) {
        self.raise_triangle(corners_enu_m.map(|corner_m| corner_m - self.r_eye_enu_m));
    }

    fn raise_triangle(&mut self, corners_m: [DVec3; 3]) {
        let ends = corners_m.map(|corner_m| (corner_m, corner_m.x.atan2(corner_m.y)));
        for k in 0..3 {
            self.raise(ends[k], ends[(k + 1) % 3]);
        }
    }

    /// Lets an edge from `a` to `b` (m, from the eye; with their azimuths [rad]) stand before the sky.
    fn raise(&mut self, (a, az_a): (DVec3, f64), (b, az_b): (DVec3, f64)) {
        let nearest_m = nearest_to_axis_m(a, b);
        if nearest_m < OVERHEAD_M {
            // Below the eye, what is farther stands higher; beside it or above it hides everything.
            let farthest_m = a.truncate().length().max(b.truncate().length());
            let height_m = a.z.max(b.z) + REACH_M;
            let bound = if height_m < 0.0 {
                height_m / farthest_m
            } else {
                f64::INFINITY
            };
            self.rise
                .iter_mut()
                .for_each(|rise| *rise = rise.max(bound));
            return;
        }
        // The eye may move: a neighbour's azimuth as well.
        let spread_rad = REACH_M / nearest_m;
        let margin = (MARGIN_RAD + spread_rad).tan();
        let turn = (az_b - az_a + PI).rem_euclid(TAU) - PI;
        // From left to right.
        let (left, right) = if turn < 0.0 { (b, a) } else { (a, b) };
        let from = if turn < 0.0 { az_a + turn } else { az_a };
        let to = from + turn.abs();
        let bin = |az: f64| (az / TAU * BINS as f64).floor() as i64;
        // Steps that begin within the edge; before and behind them its ends stand.
        let within = bin(from) + 1..=bin(to);
        let at_begin = |k: i64| match k {
            k if k < *within.start() => rise_of(left),
            k if k > *within.end() => rise_of(right),
            k => rise_on_edge(left, right, self.begins[k.rem_euclid(BINS as i64) as usize]),
        };
        let steps = bin(from - spread_rad)..=bin(to + spread_rad);
        let mut here = at_begin(*steps.start());
        for k in steps {
            let next = at_begin(k + 1);
            let slot = &mut self.rise[k.rem_euclid(BINS as i64) as usize];
            *slot = slot.max(raised(here.max(next), margin));
            here = next;
        }
    }

    /// The first row of the rectangle `rect` of a camera at `r_enu_m` in which something solid may show;
    /// its height where all of it is sky. Where the skyline cannot tell, the first of all.
    pub fn first_row(
        &self,
        pinhole: &Pinhole,
        (r_enu_m, q_enu_cam): (DVec3, DQuat),
        rect: PixelRect,
    ) -> u32 {
        // Beyond this elevation azimuths run together [rad].
        const STEEP_RAD: f64 = 1.0;
        const SAMPLES: u32 = 8;
        const MARGIN_PX: f64 = 2.0;
        let low = rect.offset_px.map(f64::from);
        let size = rect.size_px.map(f64::from);
        let direction = |u: f64, v: f64| {
            let px = DVec2::new(low[0] + u * size[0], low[1] + v * size[1]);
            los_to_az_el(q_enu_cam * pinhole.ray(px))
        };
        let middle = direction(0.5, 0.5);
        let border: Vec<DVec2> = (0..=SAMPLES)
            .map(|k| f64::from(k) / f64::from(SAMPLES))
            .flat_map(|s| [(s, 0.0), (s, 1.0), (0.0, s), (1.0, s)])
            .map(|(u, v)| direction(u, v))
            .collect();
        let steep = border.iter().any(|at| at.y.abs() > STEEP_RAD);
        if steep || r_enu_m.distance(self.r_eye_enu_m) > REACH_M {
            return 0;
        }
        let off = |az: f64| (az - middle.x + PI).rem_euclid(TAU) - PI;
        let reach = border.iter().map(|at| off(at.x).abs()).fold(0.0, f64::max);
        let bin = |az: f64| (az / TAU * BINS as f64).floor() as i64;
        let el = (bin(middle.x - reach) - 1..=bin(middle.x + reach) + 1)
            .map(|k| self.rise[k.rem_euclid(BINS as i64) as usize])
            .fold(f64::NEG_INFINITY, f64::max)
            .atan();
        if el >= STEEP_RAD {
            return 0;
        }
        let rows = (0..=2 * SAMPLES).map(|k| {
            let az = middle.x + reach * (f64::from(k) / f64::from(SAMPLES) - 1.0);
            let (sin_el, cos_el) = el.sin_cos();
            let dir_enu = DVec3::new(az.sin() * cos_el, az.cos() * cos_el, sin_el);
            let px = pinhole.project(q_enu_cam.inverse() * dir_enu);
            px.map_or(f64::NEG_INFINITY, |px| px.y)
        });
        let top = rows.fold(f64::INFINITY, f64::min) - MARGIN_PX - low[1];
        top.floor().clamp(0.0, size[1]) as u32
    }
}

/// The distance of an edge from the vertical through the eye [m].
fn nearest_to_axis_m(a: DVec3, b: DVec3) -> f64 {
    let (a, along) = (a.truncate(), (b - a).truncate());
    let length = along.length_squared();
    let t = if length > 0.0 {
        (-a.dot(along) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + t * along).length()
}

/// The tangent of a point's elevation.
fn rise_of(r: DVec3) -> f64 {
    r.z / r.truncate().length()
}

/// That of the place at which the vertical plane in the direction `level` cuts the edge, or of its nearer end.
fn rise_on_edge(a: DVec3, b: DVec3, level: DVec2) -> f64 {
    let along = b - a;
    let across = level.perp_dot(along.truncate());
    // An edge that runs along the line of sight is highest at one of its ends.
    if across.abs() < 1e-6 * along.length() {
        return rise_of(a).max(rise_of(b));
    }
    let t = -level.perp_dot(a.truncate()) / across;
    rise_of(a + t.clamp(0.0, 1.0) * along)
}

/// The tangent of an elevation of tangent `rise`, raised by an angle of tangent `margin`.
fn raised(rise: f64, margin: f64) -> f64 {
    let denominator = 1.0 - rise * margin;
    if denominator > 0.0 {
        (rise + margin) / denominator
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::kinematics::az_el_to_los;
    use crate::shape::mesh::Paint;

    const EYE_ENU_M: DVec3 = DVec3::new(10.0, -5.0, 20.0);

    /// A tower of 60 m, 200 m north of the eye, 20 m wide, and flat ground.
    fn skyline() -> Skyline {
        let mut mesh = MeshData::new(DVec3::ZERO);
        let grey = Paint::plain([0.3; 3]);
        let at = DVec3::new(10.0, 195.0, 0.0);
        mesh.cuboid(
            at - DVec3::new(10.0, 10.0, 0.0),
            at + DVec3::new(10.0, 10.0, 60.0),
            grey,
        );
        let far = 5_000.0;
        mesh.cuboid(
            DVec3::new(-far, -far, -1.0),
            DVec3::new(far, far, 0.0),
            grey,
        );
        Skyline::new(&[mesh], EYE_ENU_M)
    }

    fn first_row(az_el_deg: [f64; 2]) -> u32 {
        let pinhole = Pinhole::from_hfov(640, 480, 2_f64.to_radians()).unwrap();
        let look = az_el_to_los(DVec2::from(az_el_deg.map(f64::to_radians)));
        let right = look.cross(DVec3::Z).normalize();
        let q = DQuat::from_mat3(&glam::DMat3::from_cols(right, look.cross(right), look));
        let rect = PixelRect {
            offset_px: [0, 0],
            size_px: [640, 480],
        };
        skyline().first_row(&pinhole, (EYE_ENU_M, q), rect)
    }

    #[test]
    fn a_tower_stands_out_to_its_roof() {
        // Its roof's near edge: 40 m above the eye, 190 m away, 11.9 degrees; 640 px are 2 degrees, so
        // that 320 px are a degree, and the margin 0.3 / 190 + 1e-3 rad are 47 px.
        let roof_deg = 40_f64.atan2(190.0).to_degrees();
        let row = first_row([0.0, roof_deg]);
        assert!((180..240).contains(&row), "{row}");
        assert_eq!(first_row([0.0, roof_deg + 1.5]), 480);
        assert_eq!(first_row([0.0, roof_deg - 2.0]), 0);
        // Beside the tower there is sky down to the horizon.
        assert_eq!(first_row([20.0, 5.0]), 480);
        // Ground 20 m below ends 5 km away, 0.23 degrees down: 73 px, less the margin.
        let horizon = first_row([20.0, 0.0]);
        assert!((280..313).contains(&horizon), "{horizon}");
    }

    #[test]
    fn what_is_added_later_stands_out_too() {
        let mut later = skyline();
        let roof_enu_m = EYE_ENU_M + DVec3::new(100.0, 100.0, 60.0);
        later.add([0.0, 1.0, 2.0].map(|x| roof_enu_m + x * DVec3::new(10.0, -10.0, -30.0)));
        let bin = BINS / 8;
        let expected = (60.0_f64).atan2(100.0 * 2.0_f64.sqrt());
        let el_rad = later.rise[bin].atan();
        assert!((el_rad - expected).abs() < 5e-3, "{el_rad}");
        assert!(skyline().rise[bin] < 0.0);
    }

    #[test]
    fn where_it_cannot_tell_everything_may_be_solid() {
        assert_eq!(first_row([0.0, 80.0]), 0);
        let pinhole = Pinhole::from_hfov(640, 480, 0.03).unwrap();
        let up = DQuat::from_rotation_x(-PI / 2.0 + 0.5);
        let rect = PixelRect {
            offset_px: [0, 0],
            size_px: [640, 480],
        };
        let moved = (EYE_ENU_M + DVec3::X, up);
        assert_eq!(skyline().first_row(&pinhole, moved, rect), 0);
    }
}
