//! Selection from frame to frame: what is drawn while tiles come and go, what is loaded next and what is dropped.

use crate::tiles::selection::{Eyes, Occluder, SelectOptions, View};
use crate::tiles::tree::{Refine, TileId, Tree};

/// How a [`Selector`] chooses and keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectorOptions {
    /// The cut that is striven for.
    pub select: SelectOptions,
    /// What all contents that are kept may take [byte]. Only where the root alone takes more is more kept.
    pub budget_bytes: u64,
    /// How many tiles are loaded at the same time.
    pub at_once: usize,
    /// Whether a tile with a picture of its own waits for all its children, seen or not, before they replace it: a
    /// view that turns then finds something of the right detail everywhere.
    pub hold_siblings: bool,
}

impl Default for SelectorOptions {
    fn default() -> Self {
        Self {
            select: SelectOptions::default(),
            budget_bytes: 512 << 20, // [byte]
            at_once: 16,
            hold_siblings: true,
        }
    }
}

/// What a frame shows and sets going.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// What is drawn: all of it is loaded.
    pub draw: Vec<TileId>,
    /// What shall be read now, the most urgent first: a tile that is unread is to be expanded, another one's contents are to be
    /// loaded. Each is named once; then [`Selector::loaded`] or [`Selector::released`] is waited for.
    pub load: Vec<TileId>,
    /// Whose contents shall be freed.
    pub drop: Vec<TileId>,
    /// Whether nothing is waited for: what is drawn is the ideal cut of `max_error_px`.
    pub complete: bool,
    /// The error that the budget allows [px]: the one that was asked for, or more.
    pub max_error_px: f64,
    /// How many tiles were looked at.
    pub visited: usize,
    /// How many of them no view sees.
    pub culled: usize,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Store {
    #[default]
    Absent,
    Asked,
    Ready,
}

#[derive(Clone, Copy, Debug, Default)]
struct Slot {
    store: Store,
    /// What its contents took when they were last loaded [byte]; 0: never yet.
    bytes: u64,
    /// The frame that last had a use for it.
    used: u64,
}

/// Keeps what is loaded, from frame to frame. It loads nothing itself.
///
/// A tile stays drawn until all that replaces it can be drawn (kicking), and is kept as long as anything below it is
/// drawn: so no hole opens after the first cut where something coarser exists, neither by coming nearer nor by
/// turning nor by going away. A tile that failed ([`Tree::fail`]) counts as one that never comes: its parent stays.
/// Where the contents of a cut would not fit the budget, the error that is allowed grows until they do.
#[derive(Clone, Debug)]
pub struct Selector {
    options: SelectorOptions,
    slots: Vec<Slot>,
    /// Tiles that are not absent.
    kept: Vec<u32>,
    frame: u64,
    max_error_px: f64,
    /// Sum and number of all sizes ever seen [byte]: the guess for the others is their mean.
    known: (u64, u64),
}

impl Selector {
    /// One that has loaded nothing.
    pub fn new(options: SelectorOptions) -> Self {
        Self {
            max_error_px: options.select.max_error_px,
            options,
            slots: Vec::new(),
            kept: Vec::new(),
            frame: 0,
            known: (0, 0),
        }
    }

    /// Notes that a tile's contents are there and take so much.
    pub fn loaded(&mut self, tile: TileId, bytes: u64) {
        if let Some(slot) = self.slots.get_mut(tile.index()) {
            if slot.store == Store::Absent && !self.kept.contains(&tile.0) {
                self.kept.push(tile.0);
            }
            if slot.bytes == 0 {
                self.known = (self.known.0 + bytes, self.known.1 + 1);
            } else {
                self.known.0 = self.known.0 - slot.bytes + bytes.max(1);
            }
            (slot.store, slot.bytes) = (Store::Ready, bytes.max(1));
        }
    }

    /// Notes that a tile is no longer read: it was expanded, or has failed, or its load was given up.
    pub fn released(&mut self, tile: TileId) {
        if let Some(slot) = self.slots.get_mut(tile.index())
            && slot.store == Store::Asked
        {
            slot.store = Store::Absent;
        }
    }

    /// What all loaded contents take [byte].
    pub fn bytes(&self) -> u64 {
        let kept = self.kept.iter().map(|i| &self.slots[*i as usize]);
        let ready = kept.filter(|slot| slot.store == Store::Ready);
        ready.map(|slot| slot.bytes).sum()
    }

    /// One frame.
    pub fn update(&mut self, tree: &Tree, views: &[View], occluder: Option<&dyn Occluder>) -> Step {
        self.frame += 1;
        self.slots.resize(tree.tiles().len(), Slot::default());
        let eyes = Eyes::new(views, self.options.select.cull, occluder);
        let (plan, steady) = self.fitting_plan(tree, &eyes);
        for i in &plan.used {
            self.slots[*i as usize].used = self.frame;
        }
        let mut step = Step {
            complete: steady && plan.wanted.is_empty(),
            max_error_px: self.max_error_px,
            visited: plan.visited,
            culled: plan.culled,
            draw: plan.draw,
            ..Step::default()
        };
        self.load_and_drop(tree, plan.wanted, &mut step);
        step
    }

    /// The plan at the least error whose contents fit the budget, and whether that error stays for these views.
    fn fitting_plan(&mut self, tree: &Tree, eyes: &Eyes) -> (Plan, bool) {
        const STEP: f64 = 1.25;
        let wanted_px = self.options.select.max_error_px;
        let budget = self.options.budget_bytes;
        let mut plan = self.plan(tree, eyes, self.max_error_px);
        if plan.bytes > budget {
            // Beyond this all that is left is the root.
            while plan.bytes > budget && self.max_error_px < 1e9 * wanted_px {
                self.max_error_px *= STEP;
                plan = self.plan(tree, eyes, self.max_error_px);
            }
        } else if self.max_error_px > wanted_px {
            // Sizes once seen are kept, so this asks for nothing that would have to go again.
            let finer_px = (self.max_error_px / STEP).max(wanted_px);
            let finer = self.plan(tree, eyes, finer_px);
            if finer.bytes <= budget / 10 * 9 {
                self.max_error_px = finer_px;
                return (finer, finer_px <= wanted_px);
            }
        }
        (plan, true)
    }

    fn plan(&self, tree: &Tree, eyes: &Eyes, max_error_px: f64) -> Plan {
        let mut walk = Walk {
            tree,
            eyes,
            slots: &self.slots,
            max_error_px,
            hold_siblings: self.options.hold_siblings,
            guess: self.guess(),
            plan: Plan::default(),
        };
        if tree.root().is_some() {
            walk.visit(0, true, false);
        }
        walk.plan
    }

    /// What a content takes that was never loaded [byte].
    fn guess(&self) -> u64 {
        (self.known.0).checked_div(self.known.1).unwrap_or(1 << 20) // [byte]
    }

    /// Starts what is most urgent, as far as there is room, and makes room by dropping what was used longest ago.
    fn load_and_drop(&mut self, tree: &Tree, mut wanted: Vec<Wanted>, step: &mut Step) {
        let guess = self.guess();
        let size = |slot: &Slot| if slot.bytes > 0 { slot.bytes } else { guess };
        let (mut taken, mut asked) = (0, 0);
        let mut spare = Vec::new();
        self.kept
            .retain(|i| self.slots[*i as usize].store != Store::Absent);
        for i in &self.kept {
            let slot = &self.slots[*i as usize];
            match slot.store {
                Store::Absent => continue,
                Store::Asked => asked += 1,
                Store::Ready if slot.used < self.frame => spare.push((slot.used, *i as usize)),
                Store::Ready => {}
            }
            taken += size(slot);
        }
        spare.sort_unstable();
        let mut spare = spare.into_iter();
        let mut make_room = |slots: &mut [Slot], taken: &mut u64, more: u64| {
            while *taken + more > self.options.budget_bytes {
                let Some((_, i)) = spare.next() else {
                    return false;
                };
                *taken -= slots[i].bytes;
                slots[i].store = Store::Absent;
                step.drop.push(TileId(i as u32));
            }
            true
        };
        make_room(&mut self.slots, &mut taken, 0);
        wanted.sort_by(|a, b| {
            let late = |w: &Wanted| (w.held, w.lateness);
            (late(a).0.cmp(&late(b).0))
                .then(late(a).1.total_cmp(&late(b).1))
                .then(a.tile.cmp(&b.tile))
        });
        for Wanted { tile, .. } in wanted {
            let slot = self.slots[tile.index()];
            if asked >= self.options.at_once {
                break;
            }
            if slot.store != Store::Absent {
                continue;
            }
            let unread = tree.nodes()[tile.index()].unread;
            let more = if unread { 0 } else { size(&slot) };
            // With nothing loaded the first one comes whatever it takes.
            if !make_room(&mut self.slots, &mut taken, more) && taken > 0 && !unread {
                break;
            }
            taken += more;
            asked += 1;
            self.slots[tile.index()].store = Store::Asked;
            self.kept.push(tile.0);
            step.load.push(tile);
        }
    }
}

/// A tile that is not there yet.
struct Wanted {
    tile: TileId,
    /// Whether it is not even seen.
    held: bool,
    lateness: f64,
}

/// What a walk finds.
#[derive(Default)]
struct Plan {
    draw: Vec<TileId>,
    wanted: Vec<Wanted>,
    used: Vec<u32>,
    /// What all contents take that the ideal cut and what is kept for it need [byte].
    bytes: u64,
    visited: usize,
    culled: usize,
}

struct Walk<'a> {
    tree: &'a Tree,
    eyes: &'a Eyes<'a>,
    slots: &'a [Slot],
    max_error_px: f64,
    hold_siblings: bool,
    guess: u64,
    plan: Plan,
}

impl Walk<'_> {
    /// Plans a tile and what is below it; whether all that is seen of it will be drawn. `ask`: all above is there,
    /// so that this may be loaded; `backed`: something above can be drawn in its place.
    fn visit(&mut self, i: usize, ask: bool, backed: bool) -> bool {
        let node = &self.tree.nodes()[i];
        self.plan.visited += 1;
        let Some(refine) = self.eyes.refines(self.tree, i, self.max_error_px) else {
            self.plan.culled += 1;
            return !(backed && self.hold_siblings) || self.hold(i, ask);
        };
        if node.unread {
            self.want(i, ask, false);
            return false;
        }
        let has = node.content && !node.failed;
        let ready = has && self.need(i, ask, false);
        let refine = refine || node.always || node.failed;
        if !(refine && node.children[1] > 0) {
            if ready {
                self.plan.draw.push(TileId(i as u32));
            }
            return ready || (!node.failed && (!has || self.stand_in(i)));
        }
        let ask = ask && (ready || !has);
        if node.refine == Refine::Add {
            if ready {
                self.plan.draw.push(TileId(i as u32));
            }
            for child in node.child_range() {
                self.visit(child, ask, false);
            }
            return ready || !(has || node.failed);
        }
        let mark = self.plan.draw.len();
        let mut covered = true;
        for child in node.child_range() {
            covered &= self.visit(child, ask, backed || has);
        }
        if !covered && ready {
            self.plan.draw.truncate(mark);
            self.plan.draw.push(TileId(i as u32));
        }
        covered || ready
    }

    /// Keeps a tile ready that nobody sees, so that it can be drawn as soon as a view turns to it; whether it is.
    fn hold(&mut self, i: usize, ask: bool) -> bool {
        let node = &self.tree.nodes()[i];
        if node.unread {
            self.want(i, ask, true);
            return false;
        }
        if node.failed {
            return true;
        }
        if node.content {
            return self.need(i, ask, true);
        }
        // A tile that only leads to an external tileset.
        let children = if node.always {
            node.child_range()
        } else {
            0..0
        };
        let mut ready = true;
        for child in children {
            ready &= self.hold(child, ask);
        }
        ready
    }

    /// Counts a content and asks for it where it is not there; whether it is.
    fn need(&mut self, i: usize, ask: bool, held: bool) -> bool {
        let slot = self.slots[i];
        self.plan.used.push(i as u32);
        self.plan.bytes += if slot.bytes > 0 {
            slot.bytes
        } else {
            self.guess
        };
        let ready = slot.store == Store::Ready;
        if !ready {
            self.want(i, ask, held);
        }
        ready
    }

    fn want(&mut self, i: usize, ask: bool, held: bool) {
        if ask {
            self.plan.wanted.push(Wanted {
                tile: TileId(i as u32),
                held,
                lateness: self.eyes.lateness(self.tree.bounds(TileId(i as u32))),
            });
        }
    }

    fn unseen(&self, i: usize) -> bool {
        let refines = self.eyes.refines(self.tree, i, self.max_error_px);
        refines.is_none()
    }

    /// Draws what is there below a tile that is not; whether that shows all that is seen of it.
    fn stand_in(&mut self, i: usize) -> bool {
        let node = &self.tree.nodes()[i];
        let mark = self.plan.draw.len();
        let covered = node.refine == Refine::Replace
            && node.children[1] > 0
            && node.child_range().all(|child| {
                if self.slots[child].store == Store::Ready {
                    self.plan.used.push(child as u32);
                    self.plan.draw.push(TileId(child as u32));
                    return true;
                }
                self.unseen(child) || self.stand_in(child)
            });
        if !covered {
            self.plan.draw.truncate(mark);
        }
        covered
    }
}

#[cfg(test)]
mod tests;
