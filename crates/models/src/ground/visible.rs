//! Which triangles can be seen from places that stay: the others need not be drawn for them.
//!
//! Around a place stand the four upright faces of a cube, each cut into cells. A triangle's front covers the cells that lie
//! wholly inside its picture, or inside that of it and the next where these make one convex face, as far away as the farthest
//! point in each. A triangle that is farther than that in every cell that its own picture touches is hidden, whatever the sampling:
//! nothing can be seen past the edge of a cell that is covered whole. Gaps between other neighbours count as open, so
//! that more is kept than is seen. What looks the other way is hidden, too; what lies steeply above or below, or near, is
//! kept.

use crate::shape::mesh::MeshData;
use glam::{DMat3, DVec2, DVec3};

/// Cells along a face: 1 mrad in its middle.
const SIDE: usize = 2048;
/// How far an eye may be off its place [m]: the renderer has 24 bits.
const REACH_M: f64 = 0.01; // [m]
/// What is nearer along a face's axis hides nothing and is kept [m].
const NEAR_M: f64 = 5.0; // [m]
/// A hidden triangle is farther than what hides it by at least this share.
const FARTHER: f64 = 1e-3;

/// Takes away the triangles of `meshes` (enu) that none of the eyes [m, enu] can see, and gives back their indices, mesh by
/// mesh; without eyes it takes away none.
pub fn keep_visible(meshes: &mut [MeshData], eyes_enu_m: &[DVec3]) -> Vec<Vec<u32>> {
    if eyes_enu_m.is_empty() {
        return vec![Vec::new(); meshes.len()];
    }
    let mut seen: Vec<Vec<bool>> = (meshes.iter())
        .map(|mesh| vec![false; mesh.triangle_count()])
        .collect();
    for eye_enu_m in eyes_enu_m {
        for (seen, mesh) in seen.iter_mut().zip(visible(meshes, *eye_enu_m)) {
            seen.iter_mut().zip(mesh).for_each(|(a, b)| *a |= b);
        }
    }
    let part = |(mesh, seen): (&mut MeshData, Vec<bool>)| {
        let of = |wanted: bool| -> Vec<u32> {
            let triangles = mesh.indices.as_chunks::<3>().0.iter().zip(&seen);
            triangles
                .filter(|(_, seen)| **seen == wanted)
                .flat_map(|(triangle, _)| *triangle)
                .collect()
        };
        let (kept, taken) = (of(true), of(false));
        mesh.indices = kept;
        taken
    };
    meshes.iter_mut().zip(seen).map(part).collect()
}

/// What one face knows of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Look {
    /// It lies elsewhere.
    Beside,
    Hidden,
    Seen,
}

/// Whether each triangle of each mesh can be seen.
fn visible(meshes: &[MeshData], eye_enu_m: DVec3) -> Vec<Vec<bool>> {
    let triangles = |mesh: &MeshData| -> Vec<[DVec3; 3]> {
        let from_eye = |corners: [DVec3; 3]| corners.map(|corner| corner - eye_enu_m);
        mesh.corners_m().map(from_eye).collect()
    };
    let meshes: Vec<Vec<[DVec3; 3]>> = meshes.iter().map(triangles).collect();
    let looks = |quarter: usize| -> Vec<Vec<Look>> {
        let mut face = Face::new(quarter);
        for mesh in &meshes {
            let mut before = None;
            for corners in mesh {
                let is_front = facing_m(corners) > REACH_M;
                before = is_front.then(|| face.cover(*corners, before)).flatten();
            }
        }
        let look = |corners: &[DVec3; 3]| face.look(*corners);
        (meshes.iter())
            .map(|mesh| mesh.iter().map(look).collect())
            .collect()
    };
    let faces: Option<Vec<Vec<Vec<Look>>>> = std::thread::scope(|scope| {
        let faces = [0, 1, 2, 3].map(|quarter| scope.spawn(move || looks(quarter)));
        faces.into_iter().map(|face| face.join().ok()).collect()
    });
    let Some(faces) = faces else {
        // Without all four nothing is known to be hidden.
        return meshes.iter().map(|mesh| vec![true; mesh.len()]).collect();
    };
    let whether = |mesh: usize, triangle: usize| {
        let mut looks = faces.iter().map(|face| face[mesh][triangle]);
        let back = facing_m(&meshes[mesh][triangle]) < -REACH_M;
        // What lies beside all four faces is above or below.
        !back
            && (looks.clone().any(|look| look == Look::Seen)
                || looks.all(|look| look == Look::Beside))
    };
    (meshes.iter().enumerate())
        .map(|(m, mesh)| (0..mesh.len()).map(|t| whether(m, t)).collect())
        .collect()
}

/// How far the eye stands before the plane of a triangle [m, from the eye]; negative behind it.
fn facing_m([a, b, c]: &[DVec3; 3]) -> f64 {
    -(b - a).cross(c - a).normalize_or_zero().dot(*a)
}

/// One side of the cube.
struct Face {
    /// Turns a vector into right, down and forward of the face.
    to_face: DMat3,
    /// One over the distance along the face's axis up to which a cell is covered [1/m]; 0: it is open.
    nearness_pm: Vec<f32>,
}

/// A triangle's picture on a face.
#[derive(Clone, Debug)]
struct Picture {
    corners: [DVec2; 3],
    /// Lowest and highest nearness of its corners [1/m].
    nearness_pm: [f64; 2],
    /// Nearness over the place on the face: a plane; `None` seen edge-on.
    plane: Option<[f64; 3]>,
    /// How far the picture moves with the eye [cells].
    slack: f64,
}

impl Picture {
    /// `None` where a part of it lies nearer than [`NEAR_M`].
    fn of(corners_face_m: [DVec3; 3]) -> Option<Self> {
        let near_m = corners_face_m
            .iter()
            .map(|c| c.z)
            .fold(f64::INFINITY, f64::min);
        if near_m < NEAR_M {
            return None;
        }
        let half = 0.5 * SIDE as f64;
        let corners = corners_face_m.map(|c| half * (c.truncate() / c.z + 1.0));
        let [a, b, c] = corners;
        let nearness = corners_face_m.map(|c| 1.0 / c.z);
        let doubled = (b - a).perp_dot(c - a);
        let plane = (doubled.abs() > 1e-9).then(|| {
            let (ab, ac) = (nearness[1] - nearness[0], nearness[2] - nearness[0]);
            let across = (ab * (c - a).y - ac * (b - a).y) / doubled;
            let down = (ac * (b - a).x - ab * (c - a).x) / doubled;
            [across, down, nearness[0] - across * a.x - down * a.y]
        });
        let low = nearness.into_iter().fold(f64::INFINITY, f64::min);
        Some(Self {
            corners,
            nearness_pm: [low, 1.0 / near_m],
            plane,
            // A tangent grows by three times the angle at most, in the cube's corners.
            slack: 3.0 * half * REACH_M / near_m,
        })
    }

    /// Lowest and highest nearness in a cell [1/m]; `None` seen edge-on.
    fn nearness_pm(&self, column: usize, row: usize) -> Option<[f64; 2]> {
        let [across, down, offset] = self.plane?;
        let spread = (across.abs() + down.abs()) * (0.5 + self.slack);
        let middle = across * (column as f64 + 0.5) + down * (row as f64 + 0.5) + offset;
        Some([middle - spread, middle + spread])
    }

    /// The outline of this and another triangle, if they share an edge and are convex together.
    fn joined(&self, other: &Self) -> Option<[DVec2; 4]> {
        let (a, b) = (self.corners, other.corners);
        let edges = (0..3).flat_map(|i| (0..3).map(move |j| (i, j)));
        let mut shared = edges.filter(|(i, j)| a[*i] == b[(j + 1) % 3] && a[(i + 1) % 3] == b[*j]);
        let (i, j) = shared.next()?;
        let outline = [a[i], b[(j + 2) % 3], a[(i + 1) % 3], a[(i + 2) % 3]];
        let turns = [0, 1, 2, 3].map(|k| {
            let [from, at, to] = [0, 1, 2].map(|n| outline[(k + n) % 4]);
            (at - from).perp_dot(to - at)
        });
        let convex = turns.iter().all(|turn| *turn > 0.0) || turns.iter().all(|turn| *turn < 0.0);
        convex.then_some(outline)
    }
}

/// Calls `at` with each cell that lies wholly inside (`inner`) a convex outline or that it touches, by the cell's column and
/// row, until it says no; whether it never did. `slack`: how far the outline may be off [cells].
fn all_cells(
    outline: &[DVec2],
    slack: f64,
    inner: bool,
    mut at: impl FnMut(usize, usize) -> bool,
) -> bool {
    let edges = || outline.iter().zip(outline.iter().cycle().skip(1));
    let doubled: f64 = edges().map(|(from, to)| from.perp_dot(*to)).sum();
    let turn = doubled.signum();
    let reach = if inner { -1.0 } else { 1.0 } * (0.5 + slack);
    let low = outline.iter().copied().fold(DVec2::MAX, DVec2::min) - 0.5 - reach;
    let high = outline.iter().copied().fold(DVec2::MIN, DVec2::max) - 0.5 + reach;
    let last = (SIDE - 1) as f64;
    let rows = [low.y.ceil().max(0.0), high.y.floor().min(last)];
    if rows[0] > rows[1] {
        return true;
    }
    for row in rows[0] as usize..=rows[1] as usize {
        let y = row as f64 + 0.5;
        let mut span = [low.x.ceil().max(0.0), high.x.floor().min(last)];
        for (from, to) in edges() {
            // Positive inside; grows by `along.x` a column.
            let along = turn * DVec2::new(from.y - to.y, to.x - from.x);
            let margin = reach * (along.x.abs() + along.y.abs());
            let at_first = along.dot(DVec2::new(0.5, y) - *from) + margin;
            if along.x > 0.0 {
                span[0] = span[0].max((-at_first / along.x).ceil());
            } else if along.x < 0.0 {
                span[1] = span[1].min((at_first / -along.x).floor());
            } else if at_first < 0.0 {
                span[1] = -1.0;
            }
        }
        if span[0] > span[1] {
            continue;
        }
        for column in span[0] as usize..=span[1] as usize {
            if !at(column, row) {
                return false;
            }
        }
    }
    true
}

impl Face {
    /// The open face that looks a number of quarter turns from north over east.
    fn new(quarter: usize) -> Self {
        let forward = [DVec3::Y, DVec3::X, DVec3::NEG_Y, DVec3::NEG_X][quarter % 4];
        let right = forward.cross(DVec3::Z);
        Self {
            to_face: DMat3::from_cols(right, DVec3::NEG_Z, forward).transpose(),
            nearness_pm: vec![0.0; SIDE * SIDE],
        }
    }

    /// Lets a triangle [m, from the eye], and what it makes up with the one before, cover what lies behind. Gives back its
    /// picture.
    fn cover(&mut self, corners_m: [DVec3; 3], before: Option<Picture>) -> Option<Picture> {
        let picture = Picture::of(corners_m.map(|c| self.to_face * c))?;
        self.cover_outline(&picture.corners, &[&picture]);
        if let Some(before) = &before
            && let Some(outline) = picture.joined(before)
        {
            self.cover_outline(&outline, &[&picture, before]);
        }
        Some(picture)
    }

    /// Covers the cells within an outline as near as the farthest of its parts may be there.
    fn cover_outline(&mut self, outline: &[DVec2], parts: &[&Picture]) {
        let slack = parts.iter().map(|part| part.slack).fold(0.0, f64::max);
        all_cells(outline, slack, true, |column, row| {
            let farthest_pm = parts.iter().try_fold(f64::INFINITY, |farthest_pm, part| {
                let [low_pm, _] = part.nearness_pm(column, row)?;
                Some(low_pm.min(farthest_pm))
            });
            if let Some(nearness_pm) = farthest_pm {
                let covered = &mut self.nearness_pm[row * SIDE + column];
                *covered = covered.max(nearness_pm as f32);
            }
            true
        });
    }

    /// Whether a triangle [m, from the eye] shows on this face.
    fn look(&self, corners_m: [DVec3; 3]) -> Look {
        let corners_face_m = corners_m.map(|c| self.to_face * c);
        let beyond =
            |side: fn(DVec3) -> f64| corners_face_m.iter().all(|c| side(*c) > 2.0 * REACH_M);
        if beyond(|c| c.x - c.z)
            || beyond(|c| -c.x - c.z)
            || beyond(|c| c.y - c.z)
            || beyond(|c| -c.y - c.z)
        {
            return Look::Beside;
        }
        let steep = corners_face_m
            .iter()
            .any(|c| c.y.abs() > c.z - 2.0 * REACH_M);
        let Some(picture) = Picture::of(corners_face_m).filter(|_| !steep) else {
            return Look::Seen;
        };
        let farthest = 1.0 - FARTHER;
        let hidden = all_cells(&picture.corners, picture.slack, false, |column, row| {
            let [low_pm, high_pm] = picture.nearness_pm;
            let here_pm = picture.nearness_pm(column, row);
            let nearest_pm = here_pm.map_or(high_pm, |[_, near_pm]| near_pm.clamp(low_pm, high_pm));
            nearest_pm < farthest * f64::from(self.nearness_pm[row * SIDE + column])
        });
        if hidden { Look::Hidden } else { Look::Seen }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;
    use crate::shape::mesh::Paint;

    fn cuboid(low: [f64; 3], size: [f64; 3]) -> MeshData {
        let low = DVec3::from(low);
        let mut mesh = MeshData::new(low);
        mesh.cuboid(low, low + DVec3::from(size), Paint::plain([0.5; 3]));
        mesh
    }

    /// Triangles that are left of each mesh, seen from the origin.
    fn left(mut meshes: Vec<MeshData>) -> Vec<usize> {
        keep_visible(&mut meshes, &[DVec3::ZERO]);
        meshes.iter().map(MeshData::triangle_count).collect()
    }

    #[test]
    fn a_wall_hides_what_stands_behind_it_and_nothing_else() {
        let wall = || cuboid([-20.0, 100.0, -10.0], [40.0, 1.0, 20.0]);
        let behind = || cuboid([-3.0, 150.0, -5.0], [6.0, 6.0, 6.0]);
        // Of a box before the eye that looks at its front alone, two triangles are left.
        assert_eq!(left(vec![behind()]), [2]);
        assert_eq!(left(vec![wall(), behind()]), [2, 0]);
        assert_eq!(left(vec![behind(), wall()]), [0, 2]);
        // Over its top, past its side, and before it.
        let over = cuboid([-3.0, 150.0, 12.0], [6.0, 6.0, 6.0]);
        let past = cuboid([27.0, 150.0, -5.0], [6.0, 6.0, 6.0]);
        let before = cuboid([-3.0, 60.0, -5.0], [6.0, 6.0, 6.0]);
        for seen in [over, past, before] {
            let [wall, seen] = left(vec![wall(), seen])[..] else {
                panic!("two meshes")
            };
            assert!(wall == 2 && seen >= 2, "{wall} {seen}");
        }
        // Two eyes keep what either sees; without one all is kept.
        let mut meshes = vec![wall(), behind()];
        let taken = keep_visible(&mut meshes, &[DVec3::ZERO, DVec3::new(0.0, 300.0, 0.0)]);
        let counts: Vec<usize> = meshes.iter().map(MeshData::triangle_count).collect();
        assert_eq!(counts, [4, 2]);
        // What is taken away and what is left are all that there was.
        for ((mesh, taken), whole) in meshes.iter().zip(taken).zip([wall(), behind()]) {
            let mut triangles = [&mesh.indices[..], &taken[..]].concat();
            let (triangles, _) = triangles.as_chunks_mut::<3>();
            triangles.sort_unstable();
            let mut all = whole.indices.as_chunks::<3>().0.to_vec();
            all.sort_unstable();
            assert_eq!(triangles, all);
        }
        let mut meshes = vec![wall(), behind()];
        let taken = keep_visible(&mut meshes, &[]);
        assert!(meshes.iter().all(|mesh| mesh.triangle_count() == 12));
        assert!(taken.len() == 2 && taken.iter().all(Vec::is_empty));
    }

    /// Distance along a ray from the origin to the front of a triangle.
    fn hit_m(dir: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
        let normal = (b - a).cross(c - a);
        let towards = normal.dot(dir);
        if towards >= 0.0 {
            return None;
        }
        let t_m = normal.dot(a) / towards;
        let at = t_m * dir;
        let inside = |from: DVec3, to: DVec3| (to - from).cross(at - from).dot(normal) >= 0.0;
        (t_m > 0.0 && inside(a, b) && inside(b, c) && inside(c, a)).then_some(t_m)
    }

    #[test]
    fn the_nearest_front_of_any_ray_is_kept() {
        let mut rng = Stream::new(7, 0, "visible");
        let mut draw = |low: f64, high: f64| low + (high - low) * rng.uniform();
        let mut meshes: Vec<MeshData> = (0..400)
            .map(|_| {
                let (at, size) = (draw(0.0, std::f64::consts::TAU), draw(20.0, 400.0));
                let low = [size * at.cos(), size * at.sin(), draw(-60.0, -10.0)];
                cuboid(low, [draw(2.0, 30.0), draw(2.0, 30.0), draw(2.0, 60.0)])
            })
            .collect();
        let ground = cuboid([-900.0, -900.0, -61.0], [1800.0, 1800.0, 1.0]);
        meshes.push(ground);
        let all: Vec<[DVec3; 3]> = meshes.iter().flat_map(MeshData::corners_m).collect();
        keep_visible(&mut meshes, &[DVec3::ZERO]);
        let kept: Vec<[DVec3; 3]> = meshes.iter().flat_map(MeshData::corners_m).collect();
        assert!(
            kept.len() < all.len() / 3,
            "{} of {}",
            kept.len(),
            all.len()
        );
        let nearest = |dir: DVec3, triangles: &[[DVec3; 3]]| {
            let hits = triangles
                .iter()
                .filter_map(|triangle| hit_m(dir, *triangle));
            hits.fold(f64::INFINITY, f64::min)
        };
        let mut met = 0;
        for _ in 0..4_000 {
            let (az, el) = (draw(0.0, std::f64::consts::TAU), draw(-1.4, 0.4));
            let dir = DVec3::new(az.cos() * el.cos(), az.sin() * el.cos(), el.sin());
            let (before, after) = (nearest(dir, &all), nearest(dir, &kept));
            assert!(before == after, "{dir}: {before} m, {after} m");
            met += usize::from(before.is_finite());
        }
        assert!(met > 2_000, "{met}");
    }
}
