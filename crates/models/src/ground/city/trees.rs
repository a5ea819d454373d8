//! The meshes of trees.

use glam::{DQuat, DVec2, DVec3};

use super::parts::{Tree, TreeKind};
use crate::shape::mesh::{MeshData, Paint, Surface};

/// Leaves' linear RGB albedo.
fn leaf_albedo(tree: &Tree) -> [f32; 3] {
    let tint = tree.variant;
    match tree.kind {
        TreeKind::Broadleaf => [
            0.045 + 0.05 * tint,
            0.085 + 0.045 * tint,
            0.025 + 0.012 * tint,
        ],
        TreeKind::Autumn => [0.11 + 0.12 * tint, 0.075 + 0.03 * tint, 0.02],
        TreeKind::Conifer => [
            0.02 + 0.02 * tint,
            0.038 + 0.028 * tint,
            0.018 + 0.01 * tint,
        ],
        TreeKind::Bare => [
            0.07 + 0.035 * tint,
            0.055 + 0.025 * tint,
            0.042 + 0.02 * tint,
        ],
    }
}

/// A tree: a trunk and a crown, or twigs, of some 10 to 90 triangles. A `leafy` crown carries metres
/// around and up it, from which the shader draws clumps of leaves.
pub(super) fn add_tree(mesh: &mut MeshData, tree: &Tree, leafy: bool) {
    match tree.kind {
        TreeKind::Broadleaf | TreeKind::Autumn => add_broadleaf(mesh, tree, leafy),
        TreeKind::Conifer => add_conifer(mesh, tree, leafy),
        TreeKind::Bare => add_bare(mesh, tree),
    }
}

/// Bark of a trunk.
const BARK: [f32; 3] = [0.09, 0.065, 0.045];

/// Rings of a crown (height over the tree's, radius over the crown's), lumpy by the tree's own
/// number: no two crowns are alike. Ambient light fades toward its foot.
fn add_crown(mesh: &mut MeshData, tree: &Tree, leafy: bool, sides: usize, profile: &[(f64, f64)]) {
    let t = f64::from(tree.variant);
    let (foot, h, r) = (tree.base_enu_m, tree.height_m, tree.crown_radius_m);
    let leaves = Paint {
        albedo: leaf_albedo(tree),
        surface: Surface::Foliage,
        variant: tree.variant,
    };
    let first = mesh.positions.len();
    let rings: Vec<Vec<DVec3>> = profile
        .iter()
        .enumerate()
        .map(|(level, &(z, radius))| {
            (0..sides)
                .map(|k| {
                    let lump = (t * 57.0 + (k * (level + 3)) as f64 * 2.4).sin();
                    let angle = std::f64::consts::TAU * (k as f64 / sides as f64 + t);
                    let ring = DVec2::from_angle(angle) * r * radius * (1.0 + 0.16 * lump);
                    let sag = if radius > 0.0 { 0.03 * lump } else { 0.0 };
                    foot + ring.extend(h * (z + sag))
                })
                .collect()
        })
        .collect();
    mesh.loft(&rings, leaves);
    let foot_z = (foot.z - mesh.origin_enu_m.z) as f32;
    for (p, c) in mesh.positions[first..]
        .iter()
        .zip(&mut mesh.colors[first..])
    {
        c[3] = 0.35 + 0.65 * ((p[2] - foot_z) / h as f32).clamp(0.0, 1.0);
    }
    if !leafy {
        return;
    }
    // Around the crown there and back again, since a seam would show; no two trees alike.
    let turn_back = sides.div_ceil(2);
    let around = |k: usize| match k {
        k if k <= turn_back => k as f64,
        k => (turn_back * (sides - k)) as f64 / (sides - turn_back) as f64,
    };
    let side_m = std::f64::consts::TAU * r / sides as f64;
    for (i, uv) in mesh.uv[first..].iter_mut().enumerate() {
        let up_m = f64::from(mesh.positions[first + i][2] - foot_z).max(0.0);
        *uv = [around(i % sides) * side_m + 37.0 * t, up_m + 91.0 * t + 1.0].map(|x| x as f32);
    }
}

/// A trunk and a lumpy crown: 32 triangles.
fn add_broadleaf(mesh: &mut MeshData, tree: &Tree, leafy: bool) {
    let (foot, h) = (tree.base_enu_m, tree.height_m);
    if tree.inner {
        return add_crown(mesh, tree, leafy, 5, &[(0.4, 0.8), (0.75, 0.9), (1.0, 0.0)]);
    }
    mesh.frustum(
        (foot - DVec3::Z * 0.3, 0.035 * h),
        (foot + DVec3::Z * 0.38 * h, 0.02 * h),
        3,
        Paint::plain(BARK),
    );
    add_crown(
        mesh,
        tree,
        leafy,
        6,
        &[(0.24, 0.0), (0.45, 0.95), (0.78, 0.8), (1.0, 0.0)],
    );
}

/// Two or three tiers of drooping branches about a trunk.
fn add_conifer(mesh: &mut MeshData, tree: &Tree, leafy: bool) {
    let (foot, h) = (tree.base_enu_m, tree.height_m);
    if tree.inner {
        return add_crown(
            mesh,
            tree,
            leafy,
            5,
            &[(0.3, 0.95), (0.66, 0.5), (1.0, 0.0)],
        );
    }
    mesh.frustum(
        (foot - DVec3::Z * 0.3, 0.016 * h),
        (foot + DVec3::Z * 0.2 * h, 0.013 * h),
        3,
        Paint::plain(BARK),
    );
    add_crown(
        mesh,
        tree,
        leafy,
        7,
        &[(0.08, 0.8), (0.13, 1.0), (0.5, 0.42)],
    );
    add_crown(mesh, tree, leafy, 6, &[(0.42, 0.74), (0.75, 0.24)]);
    add_crown(mesh, tree, leafy, 5, &[(0.68, 0.44), (1.0, 0.0)]);
}

/// A trunk, its branches and twigs as blades that are seen from both sides.
fn add_bare(mesh: &mut MeshData, tree: &Tree) {
    let t = f64::from(tree.variant);
    let (foot, h, r) = (tree.base_enu_m, tree.height_m, tree.crown_radius_m);
    let wood = Paint::plain(leaf_albedo(tree));
    let up = DVec3::Z;
    mesh.frustum(
        (foot - up * 0.3, 0.017 * h),
        (foot + up * 0.8 * h, 0.005 * h),
        3,
        wood,
    );
    let mut blade = |from: DVec3, to: DVec3, width_m: f64, side: DVec3| {
        let across = (to - from).cross(side).normalize_or(side) * width_m / 2.0;
        mesh.face(&[from - across, from + across, to], wood);
        mesh.face(&[from + across, from - across, to], wood);
    };
    const GOLDEN_RAD: f64 = 2.399_963; // [rad]
    let branches = if tree.inner { 5 } else { 11 };
    for k in 0..branches {
        let share = (k as f64 + 0.5) / branches as f64;
        let out = DVec2::from_angle(GOLDEN_RAD * k as f64 + 6.3 * t).extend(0.0);
        let from = foot + up * h * (0.28 + 0.45 * share);
        // The crown's outline is an egg: widest at half height.
        let reach = r * (1.0 - (share - 0.35).powi(2) * 1.4);
        let rise = h * (0.16 + 0.12 * share + 0.05 * (t * 40.0 + k as f64).sin());
        let to = from + out * reach + up * rise;
        let side = out.cross(up);
        blade(from, to, 0.012 * h, side);
        for (along, turn) in [(0.45, 0.8), (0.7, -0.8)] {
            let twig = DQuat::from_rotation_z(turn) * out * 0.45 * reach + up * 0.13 * h;
            let knot = from.lerp(to, along);
            blade(knot, knot + twig, 0.008 * h, up);
        }
    }
}
