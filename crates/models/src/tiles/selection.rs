//! Which tiles are drawn: selection by screen-space error, as cesium-native's documentation describes it
//! ("Selection algorithm details").

use crate::tiles::tree::{Refine, TileId, Tree};
use crate::tiles::volume::{Bounds, Frustum};
use glam::DVec3;

/// A camera, in the tree's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where it stands [m].
    pub r_root_m: DVec3,
    /// Where it looks: a unit vector.
    pub forward: DVec3,
    /// What is up in its picture; need not be perpendicular to `forward`.
    pub up: DVec3,
    /// Its vertical field of view [rad].
    pub fovy_rad: f64,
    /// Columns and rows of its picture.
    pub size_px: [u32; 2],
}

/// How a cut is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectOptions {
    /// A tile refines while its error on a screen is this or more [px].
    pub max_error_px: f64,
    /// Whether tiles outside all pictures are left out.
    pub cull: bool,
}

impl Default for SelectOptions {
    fn default() -> Self {
        Self {
            max_error_px: 16.0, // [px]
            cull: true,
        }
    }
}

/// Knows what is hidden behind something else: occlusion culling, where a caller has the means.
pub trait Occluder: Sync {
    /// Whether a view certainly sees nothing of a volume.
    fn hides(&self, view: &View, bounds: &Bounds) -> bool;
}

/// A set of tiles that shows the whole scene once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// What is drawn, in the order of a walk. As long as something is unread it is a coarser cut than asked for.
    pub draw: Vec<TileId>,
    /// What must be expanded before the cut is complete.
    pub unread: Vec<TileId>,
    /// How many tiles were looked at.
    pub visited: usize,
    /// How many of them no view sees.
    pub culled: usize,
}

/// Error on the screen [px] of an error in space [m] at a distance [m], on a picture of some height [px] and
/// vertical field of view [rad]: error · height / (distance · 2 · tan(fovy / 2)). Infinite at no distance.
pub fn screen_space_error_px(error_m: f64, distance_m: f64, height_px: f64, fovy_rad: f64) -> f64 {
    if distance_m > 0.0 {
        error_m * height_px / (distance_m * 2.0 * (0.5 * fovy_rad).tan())
    } else {
        f64::INFINITY
    }
}

/// The cut that the views ask for: a function of tree and views alone.
pub fn ideal_cut(tree: &Tree, views: &[View], options: &SelectOptions) -> Cut {
    ideal_cut_behind(tree, views, options, None)
}

/// The same, without what something hides.
pub fn ideal_cut_behind(
    tree: &Tree,
    views: &[View],
    options: &SelectOptions,
    occluder: Option<&dyn Occluder>,
) -> Cut {
    let eyes = Eyes::new(views, options.cull, occluder);
    cut(tree, &|tree, i| eyes.refines(tree, i, options.max_error_px))
}

/// The cut at a fixed level of detail, whatever is on screen: the coarsest tiles with an error of `error_m` [m] or
/// less that come within `radius_m` of a point.
pub fn fixed_cut(tree: &Tree, center_root_m: DVec3, radius_m: f64, error_m: f64) -> Cut {
    cut(tree, &|tree, i| {
        let near = tree.bounds(TileId(i as u32)).distance_m(center_root_m) <= radius_m;
        near.then_some(tree.nodes()[i].error_m > error_m)
    })
}

/// The cut for a judgement of each tile: unseen (`None`), or seen, and whether it shall refine.
fn cut(tree: &Tree, judge: &impl Fn(&Tree, usize) -> Option<bool>) -> Cut {
    let mut cut = Cut::default();
    if tree.root().is_some() {
        walk(tree, 0, judge, &mut cut);
    }
    cut
}

/// Adds a tile and what is below it; whether all that is seen of it will be drawn. The depth of a tree is bounded
/// where it is read.
fn walk(
    tree: &Tree,
    i: usize,
    judge: &impl Fn(&Tree, usize) -> Option<bool>,
    cut: &mut Cut,
) -> bool {
    let node = &tree.nodes()[i];
    let id = TileId(i as u32);
    cut.visited += 1;
    let Some(refine) = judge(tree, i) else {
        cut.culled += 1;
        return true;
    };
    if node.unread {
        cut.unread.push(id);
        return false;
    }
    let ready = node.content && !node.failed;
    let refine = (refine || node.always || node.failed) && node.children[1] > 0;
    let mark = cut.draw.len();
    if ready && !(refine && node.refine == Refine::Replace) {
        cut.draw.push(id);
    }
    if !refine {
        return !node.failed;
    }
    let mut covered = true;
    for child in node.child_range() {
        covered &= walk(tree, child, judge, cut);
    }
    match node.refine {
        Refine::Add => !node.failed,
        Refine::Replace if !covered && ready => {
            cut.draw.truncate(mark);
            cut.draw.push(id);
            true
        }
        Refine::Replace => covered,
    }
}

/// The views, made ready for a walk.
pub(super) struct Eyes<'a> {
    eyes: Vec<Eye<'a>>,
    cull: bool,
    occluder: Option<&'a dyn Occluder>,
}

struct Eye<'a> {
    view: &'a View,
    frustum: Frustum,
    /// Pixels of one radian in the picture's middle [px].
    focal_px: f64,
}

impl<'a> Eyes<'a> {
    pub(super) fn new(views: &'a [View], cull: bool, occluder: Option<&'a dyn Occluder>) -> Self {
        let eye = |view: &'a View| {
            let tan_up = (0.5 * view.fovy_rad).tan();
            let [columns, rows] = view.size_px.map(f64::from);
            let tan_across = tan_up * columns / rows.max(1.0);
            Eye {
                view,
                frustum: Frustum::new(view.r_root_m, view.forward, view.up, tan_across, tan_up),
                focal_px: rows / (2.0 * tan_up),
            }
        };
        Self {
            eyes: views.iter().map(eye).collect(),
            cull,
            occluder,
        }
    }

    /// Whether a tile's error is `max_error_px` [px] or more in any picture that sees it; `None` where none does.
    /// The error is that of [`screen_space_error_px`], the distance that of the nearest point of its volume.
    pub(super) fn refines(&self, tree: &Tree, i: usize, max_error_px: f64) -> Option<bool> {
        let node = &tree.nodes()[i];
        let bounds = || tree.bounds(TileId(i as u32));
        let mut seen = None;
        for eye in &self.eyes {
            let sees = |frustum: &Frustum| frustum.sees(node.center_m, node.radius_m, bounds);
            if (node.request && !inside_request(tree, i, eye.view))
                || (self.cull && !sees(&eye.frustum))
                || (self.occluder).is_some_and(|o| o.hides(eye.view, bounds()))
            {
                continue;
            }
            let reaches =
                |distance_m: f64| node.error_m * eye.focal_px >= max_error_px * distance_m;
            // The ball around it often tells; at no distance the error is infinite.
            let middle_m = node.center_m.distance(eye.view.r_root_m);
            let nearest_m = middle_m - node.radius_m;
            if reaches(middle_m)
                || ((nearest_m <= 0.0 || reaches(nearest_m))
                    && reaches(bounds().distance_m(eye.view.r_root_m)))
            {
                return Some(true);
            }
            seen = Some(false);
        }
        seen
    }

    /// How late a tile may be loaded: the least (1 − cos angle) · distance [m] of all views, the angle between where
    /// a view looks and the tile's middle.
    pub(super) fn lateness(&self, bounds: &Bounds) -> f64 {
        let of = |eye: &Eye| {
            let towards = bounds.center_m - eye.view.r_root_m;
            let distance_m = bounds.distance_m(eye.view.r_root_m);
            let cos = towards
                .try_normalize()
                .map_or(1.0, |d| d.dot(eye.view.forward));
            (1.0 - cos) * distance_m
        };
        self.eyes.iter().map(of).fold(f64::INFINITY, f64::min)
    }
}

/// Whether a viewer stands inside a tile's viewer request volume.
fn inside_request(tree: &Tree, i: usize, view: &View) -> bool {
    let tile = &tree.tiles()[i];
    (tile.viewer_request_volume.as_ref())
        .is_none_or(|volume| Bounds::of(volume, &tile.to_root_m).distance_m(view.r_root_m) <= 0.0)
}

#[cfg(test)]
mod tests;
