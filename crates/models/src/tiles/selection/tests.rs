use super::*;
use crate::tiles::tree::Tile;
use crate::tiles::volume::BoundingVolume;
use glam::{DAffine3, DMat3};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_3, FRAC_PI_6};

#[test]
fn screen_space_error_at_the_check_values() {
    let first = screen_space_error_px(16.0, 1000.0, 1080.0, FRAC_PI_3);
    assert!((first - 14.9649).abs() < 5e-5, "{first}");
    let second = screen_space_error_px(1.0, 100.0, 480.0, FRAC_PI_6);
    assert!((second - 8.95692).abs() < 5e-6, "{second}");
    assert_eq!(screen_space_error_px(0.0, 0.0, 480.0, 1.0), f64::INFINITY);
}

/// A tile of a random tree, by its own description: nothing of the tree's.
#[derive(Clone, Debug)]
struct Plain {
    center: DVec3,
    half: DVec3,
    ball: bool,
    error_m: f64,
    add: bool,
    content: bool,
    failed: bool,
    scale: f64,
    request: Option<f64>,
    children: Vec<Plain>,
}

fn plain() -> impl Strategy<Value = Plain> {
    let own = (
        prop::array::uniform3(-50.0..50.0f64),
        prop::array::uniform3(0.1..40.0f64),
        0.0..8.0f64,
        0.5..2.0f64,
        prop::array::uniform4(0..8u8),
        10.0..200.0f64,
    );
    let own = own.prop_map(|(center, half, error_m, scale, dice, reach)| Plain {
        center: DVec3::from_array(center),
        half: DVec3::from_array(half),
        ball: dice[0] < 3,
        error_m,
        add: dice[1] < 3,
        content: dice[2] < 6,
        failed: dice[3] == 0,
        scale,
        request: (dice[3] == 1).then_some(reach),
        children: Vec::new(),
    });
    own.clone().prop_recursive(5, 120, 5, move |inner| {
        (own.clone(), prop::collection::vec(inner, 0..5)).prop_map(|(mut tile, children)| {
            tile.children = children;
            tile
        })
    })
}

impl Plain {
    fn volume(&self) -> BoundingVolume {
        if self.ball {
            BoundingVolume::Sphere {
                center_m: self.center,
                radius_m: self.half.x,
            }
        } else {
            BoundingVolume::Box {
                center_m: self.center,
                half_axes_m: DMat3::from_diagonal(self.half),
            }
        }
    }

    fn tile(&self, above: &DAffine3) -> Tile {
        Tile {
            volume: self.volume(),
            viewer_request_volume: self.request.map(|radius_m| BoundingVolume::Sphere {
                center_m: self.center,
                radius_m,
            }),
            geometric_error_m: self.error_m,
            refine: if self.add {
                Refine::Add
            } else {
                Refine::Replace
            },
            to_root_m: *above * DAffine3::from_scale(DVec3::splat(self.scale)),
            contents: if self.content {
                vec!["x".into()]
            } else {
                Vec::new()
            },
            unread: None,
        }
    }

    fn grow(&self, tree: &mut Tree, id: TileId) {
        let above = tree.tile(id).to_root_m;
        let tiles = self
            .children
            .iter()
            .map(|child| child.tile(&above))
            .collect();
        for (place, child) in tree.add_children(id, tiles).zip(&self.children) {
            child.grow(tree, TileId(place));
        }
        if self.failed {
            tree.fail(id);
        }
    }

    /// The reference: the rules one by one, with geometry of its own (all transforms are scales about the origin).
    /// What is drawn, by the order of a depth-first count, and whether it shows all that is seen.
    fn draw(
        &self,
        views: &[View],
        max_px: f64,
        above: (f64, f64),
        number: &mut u32,
        out: &mut Vec<u32>,
    ) -> bool {
        let own = *number;
        *number += 1;
        let scale = above.0 * self.scale;
        let error_m = self.error_m * scale;
        let mut seen = false;
        let mut refine = self.failed || error_m > above.1;
        for view in views {
            let eye = view.r_root_m / scale;
            if self
                .request
                .is_some_and(|reach| eye.distance(self.center) > reach)
            {
                continue;
            }
            seen = true;
            let nearest = if self.ball {
                (eye.distance(self.center) - self.half.x).max(0.0)
            } else {
                eye.clamp(self.center - self.half, self.center + self.half)
                    .distance(eye)
            };
            let tall = 2.0 * nearest * scale * (view.fovy_rad / 2.0).tan();
            refine |= tall <= 0.0 || error_m * f64::from(view.size_px[1]) / tall >= max_px;
        }
        let mut below = Vec::new();
        let mut covered = true;
        for child in &self.children {
            covered &= child.draw(views, max_px, (scale, error_m), number, &mut below);
        }
        if !seen {
            return true;
        }
        let own_picture = self.content && !self.failed;
        if self.children.is_empty() || !refine {
            out.extend(own_picture.then_some(own));
            return !self.failed;
        }
        if self.add {
            out.extend(own_picture.then_some(own));
            out.extend(below);
            return !self.failed;
        }
        if covered || !own_picture {
            out.extend(below);
            return covered;
        }
        out.push(own);
        true
    }
}

/// Numbers of tiles in the order of a depth-first walk.
fn depth_first(tree: &Tree) -> Vec<TileId> {
    fn down(tree: &Tree, id: TileId, order: &mut Vec<TileId>) {
        order.push(id);
        tree.children(id).for_each(|child| down(tree, child, order));
    }
    let mut order = Vec::new();
    down(tree, TileId(0), &mut order);
    order
}

fn view(eye: [f64; 3], fovy_rad: f64) -> View {
    View {
        r_root_m: DVec3::from_array(eye),
        forward: -DVec3::from_array(eye).try_normalize().unwrap_or(DVec3::X),
        up: DVec3::Z,
        fovy_rad,
        size_px: [640, 480],
    }
}

proptest! {
    #[test]
    fn the_cut_is_that_of_an_independent_traversal(
        root in plain(),
        eyes in prop::collection::vec((prop::array::uniform3(-300.0..300.0f64), 0.02..1.5f64), 1..4),
        max_px in 1.0..60.0f64,
    ) {
        let mut tree = Tree::new(root.tile(&DAffine3::IDENTITY));
        root.grow(&mut tree, TileId(0));
        let views: Vec<View> = eyes.into_iter().map(|(eye, fovy)| view(eye, fovy)).collect();
        let options = SelectOptions { max_error_px: max_px, cull: false };
        let cut = ideal_cut(&tree, &views, &options);
        let mut expected = Vec::new();
        root.draw(&views, max_px, (1.0, f64::INFINITY), &mut 0, &mut expected);
        let order = depth_first(&tree);
        let expected: Vec<TileId> = expected.into_iter().map(|n| order[n as usize]).collect();
        prop_assert_eq!(cut.draw, expected);
        prop_assert!(cut.unread.is_empty());
    }

    /// Culling only takes away what no picture shows; what is drawn without it and seen is drawn with it, or something
    /// in its place.
    #[test]
    fn culling_takes_away_only_what_is_unseen(root in plain(), eye in prop::array::uniform3(-300.0..300.0f64)) {
        let mut tree = Tree::new(root.tile(&DAffine3::IDENTITY));
        root.grow(&mut tree, TileId(0));
        let views = [view(eye, 0.3)];
        let eyes = Eyes::new(&views, true, None);
        let culled = ideal_cut(&tree, &views, &SelectOptions::default());
        for id in &culled.draw {
            prop_assert!(eyes.refines(&tree, id.index(), 16.0).is_some());
        }
        prop_assert!(culled.visited <= tree.tiles().len());
    }
}

/// A root with four quarters of 100 m, 1 km ahead.
fn quarters(refine: Refine) -> Tree {
    let tile = |center_m: DVec3, edge_m: f64, geometric_error_m: f64| Tile {
        volume: BoundingVolume::Box {
            center_m,
            half_axes_m: DMat3::from_diagonal(DVec3::splat(0.5 * edge_m)),
        },
        viewer_request_volume: None,
        geometric_error_m,
        refine,
        to_root_m: DAffine3::IDENTITY,
        contents: vec!["x".into()],
        unread: None,
    };
    let center = DVec3::new(0.0, 1000.0, 0.0);
    let mut tree = Tree::new(tile(center, 200.0, 30.0));
    let quarter = |x: f64, z: f64| tile(center + DVec3::new(x, 0.0, z), 100.0, 0.0);
    let children = vec![
        quarter(-50.0, -50.0),
        quarter(50.0, -50.0),
        quarter(-50.0, 50.0),
        quarter(50.0, 50.0),
    ];
    tree.add_children(TileId(0), children);
    tree
}

fn ahead(fovy_deg: f64) -> View {
    View {
        r_root_m: DVec3::ZERO,
        forward: DVec3::Y,
        up: DVec3::Z,
        fovy_rad: fovy_deg.to_radians(),
        size_px: [640, 480],
    }
}

#[test]
fn a_camera_of_1_degree_draws_what_one_of_60_does_not() {
    let tree = quarters(Refine::Replace);
    let options = SelectOptions {
        max_error_px: 16.0,
        cull: false,
    };
    // 30 m at 900 m: 13.9 px at 60°, 917 px at 1°.
    assert_eq!(ideal_cut(&tree, &[ahead(60.0)], &options).draw, [TileId(0)]);
    let fine = ideal_cut(&tree, &[ahead(60.0), ahead(1.0)], &options).draw;
    assert_eq!(fine, (1..5).map(TileId).collect::<Vec<_>>());
    let both = ideal_cut(&quarters(Refine::Add), &[ahead(1.0)], &options).draw;
    assert_eq!(both.len(), 5);
}

#[test]
fn a_tile_that_failed_leaves_its_parent() {
    let mut tree = quarters(Refine::Replace);
    tree.fail(TileId(3));
    let options = SelectOptions {
        max_error_px: 16.0,
        cull: false,
    };
    assert_eq!(ideal_cut(&tree, &[ahead(1.0)], &options).draw, [TileId(0)]);
    // Where it is not seen nothing is missing.
    let mut below = ahead(1.0);
    below.forward = DVec3::new(-0.05, 1.0, -0.05).normalize();
    assert_eq!(
        ideal_cut(&tree, &[below], &SelectOptions::default()).draw,
        [TileId(1)]
    );
}

#[test]
fn a_fixed_level_of_detail_minds_no_view() {
    let tree = quarters(Refine::Replace);
    let all = fixed_cut(&tree, DVec3::new(0.0, 1000.0, 0.0), 500.0, 1.0);
    assert_eq!(all.draw.len(), 4);
    let corner = fixed_cut(&tree, DVec3::new(80.0, 1000.0, 80.0), 10.0, 1.0);
    assert_eq!(corner.draw, [TileId(4)]);
    assert_eq!(
        fixed_cut(&tree, DVec3::new(0.0, 1000.0, 0.0), 500.0, 30.0).draw,
        [TileId(0)]
    );
}
