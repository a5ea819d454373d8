use super::*;
use crate::tiles::selection::ideal_cut;
use crate::tiles::tree::Tile;
use crate::tiles::volume::BoundingVolume;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeSet;

/// A quadtree on the ground, 1024 m wide, four levels below the root.
fn ground(root_content: bool) -> Tree {
    let tile = |x: f64, y: f64, edge_m: f64, content: bool| Tile {
        volume: BoundingVolume::Box {
            center_m: DVec3::new(x, y, 0.0),
            half_axes_m: DMat3::from_diagonal(DVec3::new(0.5 * edge_m, 0.5 * edge_m, 5.0)),
        },
        viewer_request_volume: None,
        geometric_error_m: if edge_m < 65.0 { 0.0 } else { edge_m / 32.0 },
        refine: Refine::Replace,
        to_root_m: DAffine3::IDENTITY,
        contents: if content {
            vec!["x".into()]
        } else {
            Vec::new()
        },
        unread: None,
    };
    let mut tree = Tree::new(tile(0.0, 0.0, 1024.0, root_content));
    let mut level = vec![(TileId(0), 0.0, 0.0, 1024.0)];
    while let Some((id, x, y, edge_m)) = level.pop() {
        if edge_m < 65.0 {
            continue;
        }
        let q = 0.25 * edge_m;
        let places = [
            (x - q, y - q),
            (x + q, y - q),
            (x - q, y + q),
            (x + q, y + q),
        ];
        let tiles = places
            .iter()
            .map(|(x, y)| tile(*x, *y, 0.5 * edge_m, true))
            .collect();
        for (child, (x, y)) in tree.add_children(id, tiles).zip(places) {
            level.push((TileId(child), x, y, 0.5 * edge_m));
        }
    }
    tree
}

fn looking(from: DVec3, towards: DVec3) -> View {
    View {
        r_root_m: from,
        forward: (towards - from).normalize(),
        up: DVec3::Z,
        fovy_rad: 0.6,
        size_px: [1280, 960],
    }
}

/// A host whose loads take some frames.
struct Host {
    tree: Tree,
    selector: Selector,
    flying: Vec<(u64, TileId)>,
    frame: u64,
    delay: u64,
    loads: usize,
    most: u64,
}

const TILE: u64 = 1000; // [byte]

impl Host {
    fn new(tree: Tree, budget_bytes: u64, delay: u64) -> Self {
        let options = SelectorOptions {
            budget_bytes,
            at_once: 8,
            ..SelectorOptions::default()
        };
        Self {
            tree,
            selector: Selector::new(options),
            flying: Vec::new(),
            frame: 0,
            delay,
            loads: 0,
            most: 0,
        }
    }

    fn frame(&mut self, view: &View) -> Step {
        self.frame += 1;
        let (tree, frame, selector) = (&mut self.tree, self.frame, &mut self.selector);
        self.flying.retain(|(due, tile)| {
            if *due > frame {
                return true;
            }
            if tree.failed(*tile) {
                selector.released(*tile);
            } else {
                selector.loaded(*tile, TILE);
            }
            false
        });
        let step = self.selector.update(&self.tree, &[*view], None);
        self.loads += step.load.len();
        self.flying.extend(
            step.load
                .iter()
                .map(|tile| (self.frame + self.delay, *tile)),
        );
        self.most = self.most.max(self.selector.bytes());
        step
    }

    fn settle(&mut self, view: &View) -> Step {
        for _ in 0..2000 {
            let step = self.frame(view);
            if step.complete && self.flying.is_empty() {
                return step;
            }
        }
        panic!("never complete")
    }
}

/// Whether what is drawn shows every leaf that is seen exactly once.
fn whole(tree: &Tree, step: &Step, view: &View) -> bool {
    let draw: BTreeSet<TileId> = step.draw.iter().copied().collect();
    let leaves = (0..tree.tiles().len() as u32)
        .map(TileId)
        .filter(|id| tree.children(*id).next().is_none());
    let eyes = [*view];
    let eyes = Eyes::new(&eyes, true, None);
    leaves
        .filter(|leaf| eyes.refines(tree, leaf.index(), 16.0).is_some())
        .all(|leaf| {
            let chain = std::iter::successors(Some(leaf), |id| tree.parent(*id));
            chain.filter(|id| draw.contains(id)).count() == 1
        })
}

#[test]
fn with_time_and_room_it_draws_the_ideal_cut() {
    for failed in [None, Some(7), Some(30)] {
        let mut tree = ground(true);
        if let Some(failed) = failed {
            tree.fail(TileId(failed));
        }
        let mut host = Host::new(tree, u64::MAX, 2);
        for eye in [
            DVec3::new(0.0, -600.0, 50.0),
            DVec3::new(200.0, 100.0, 900.0),
            DVec3::new(-90.0, 80.0, 20.0),
        ] {
            let view = looking(eye, DVec3::ZERO);
            let step = host.settle(&view);
            let ideal = ideal_cut(&host.tree, &[view], &SelectOptions::default());
            assert_eq!(step.draw, ideal.draw, "{eye} {failed:?}");
            assert_eq!(step.max_error_px, 16.0);
        }
    }
}

#[test]
fn no_hole_opens_once_something_was_there() {
    let mut host = Host::new(ground(true), u64::MAX, 7);
    let mut shown = false;
    for i in 0..900 {
        let t = f64::from(i) / 900.0;
        // Comes down, turns, goes away again, fast.
        let angle = 25.0 * t;
        let height = 20.0 + 1500.0 * (2.0 * t - 1.0).abs();
        let eye = DVec3::new(300.0 * angle.cos(), 300.0 * angle.sin(), height);
        let view = looking(eye, DVec3::new(100.0 * (9.0 * t).sin(), 0.0, 0.0));
        let step = host.frame(&view);
        shown |= !step.draw.is_empty();
        assert!(
            !shown || whole(&host.tree, &step, &view),
            "frame {i}: {:?}",
            step.draw
        );
    }
    assert!(shown && host.loads > 100);
}

#[test]
fn a_view_that_turns_finds_the_next_tiles_there() {
    let mut host = Host::new(ground(true), u64::MAX, 5);
    let eye = DVec3::new(0.0, 0.0, 60.0);
    host.settle(&looking(eye, DVec3::new(0.0, 300.0, 0.0)));
    let other = looking(eye, DVec3::new(0.0, -300.0, 0.0));
    let step = host.frame(&other);
    // Not the root: the quarters were held, and stay while finer ones come.
    assert!(!step.draw.contains(&TileId(0)) && whole(&host.tree, &step, &other));
}

#[test]
fn a_budget_that_does_not_fit_coarsens_and_does_not_thrash() {
    let view = looking(DVec3::new(0.0, -100.0, 40.0), DVec3::ZERO);
    let mut free = Host::new(ground(true), u64::MAX, 2);
    free.settle(&view);
    let (needed, all) = (free.selector.bytes(), free.loads);
    let budget = needed / 2;
    let mut host = Host::new(ground(true), budget, 2);
    let step = host.settle(&view);
    assert!(step.max_error_px > 16.0 && host.most <= budget);
    assert!(whole(&host.tree, &step, &view));
    // Standing still nothing is loaded twice.
    let (loads, drawn) = (host.loads, step.draw);
    for _ in 0..500 {
        let step = host.frame(&view);
        assert!(step.load.is_empty() && step.drop.is_empty() && step.draw == drawn);
    }
    assert!(loads < all, "{loads} of {all}");
    // Farther away it fits again, and the error comes back.
    let far = looking(DVec3::new(0.0, -3000.0, 2000.0), DVec3::ZERO);
    let step = host.settle(&far);
    (0..40).for_each(|_| _ = host.frame(&far));
    assert_eq!(host.frame(&far).max_error_px, 16.0, "{step:?}");
    assert!(host.most <= budget);
}

#[test]
fn a_flight_stays_within_its_budget() {
    for budget in [20 * TILE, 60 * TILE] {
        let mut host = Host::new(ground(true), budget, 3);
        let mut holes = 0;
        let mut shown = false;
        for i in 0..2000 {
            let t = f64::from(i) / 100.0;
            let eye = DVec3::new(
                400.0 * t.cos(),
                400.0 * (0.7 * t).sin(),
                60.0 + 50.0 * (0.3 * t).sin(),
            );
            let view = looking(eye, eye + DVec3::new(-t.sin(), t.cos(), -0.2));
            let step = host.frame(&view);
            assert!(host.selector.bytes() <= budget, "{}", host.selector.bytes());
            shown |= !step.draw.is_empty();
            holes += usize::from(shown && !whole(&host.tree, &step, &view));
        }
        assert_eq!(holes, 0, "budget {budget}");
    }
}

#[test]
fn a_tile_that_fails_on_the_way_leaves_its_parent_and_is_not_asked_for_again() {
    let mut host = Host::new(ground(true), u64::MAX, 1);
    let view = looking(DVec3::new(0.0, -100.0, 40.0), DVec3::ZERO);
    host.frame(&view);
    let mut asked = Vec::new();
    for _ in 0..200 {
        let step = host.frame(&view);
        if step.load.contains(&TileId(2)) {
            host.tree.fail(TileId(2));
        }
        asked.extend(step.load.iter().copied());
        assert!(step.draw.is_empty() || whole(&host.tree, &step, &view));
    }
    assert!(asked.iter().filter(|id| **id == TileId(2)).count() <= 1);
}

#[test]
fn the_most_urgent_is_what_stands_ahead() {
    let mut host = Host::new(ground(false), u64::MAX, 1);
    let view = looking(DVec3::new(0.0, 0.0, 30.0), DVec3::new(400.0, 300.0, 0.0));
    let step = host.frame(&view);
    let ahead = DVec3::new(256.0, 256.0, 0.0);
    let first = host.tree.bounds(step.load[0]).center_m;
    assert!(first.distance(ahead) < 1.0, "{first}");
}
