//! Reads subtrees of implicit tilings, binary and JSON (OGC 22-025r4, section 7.2.6, "Subtrees").

use crate::tiles::error::TilesError;
use crate::tiles::expansion::{Expansion, Loose, Tiling, Wait};
use crate::tiles::fetch::{Fetcher, resolve};
use crate::tiles::json::{At, parse};
use crate::tiles::semantics::{Table, Views};
use boresight_models::tiles::implicit::{Availability, Coordinates};
use boresight_models::tiles::tree::Tile;
use serde_json::Value;
use std::sync::Arc;

/// The most tiles that one subtree may have: with constant availability a few bytes promise any number.
const MOST_TILES: usize = 1 << 19;

/// The bytes that a subtree speaks of: read when they are first asked for.
struct Buffers<'a> {
    fetcher: &'a Fetcher,
    json: At<'a>,
    /// What follows the JSON of a binary subtree.
    own: &'a [u8],
}

/// Splits a subtree into its JSON and the buffer that comes with it.
fn split<'a>(location: &str, bytes: &'a [u8]) -> Result<(&'a [u8], &'a [u8]), TilesError> {
    let fault = |fault: &str| TilesError::Format {
        location: location.into(),
        place: "header".into(),
        fault: fault.into(),
    };
    if !bytes.starts_with(b"subt") {
        let json = bytes.trim_ascii_start().strip_prefix(b"\xef\xbb\xbf");
        if json.unwrap_or(bytes.trim_ascii_start()).starts_with(b"{") {
            return Ok((bytes, &[]));
        }
        return Err(fault("begins with neither 'subt' nor '{': is no subtree"));
    }
    let number = |at: usize| {
        let field = bytes
            .get(at..at + 8)
            .and_then(|b| <[u8; 8]>::try_from(b).ok());
        field.map(u64::from_le_bytes)
    };
    let (Some(json), Some(own)) = (number(8), number(16)) else {
        return Err(fault("is cut short; export it again"));
    };
    if bytes[4..8] != 1u32.to_le_bytes() {
        return Err(fault("has another version than 1; export it again"));
    }
    let rest = &bytes[24..];
    let (Ok(json), Ok(own)) = (usize::try_from(json), usize::try_from(own)) else {
        return Err(fault("names impossible lengths; export it again"));
    };
    let end = json.checked_add(own).filter(|end| *end <= rest.len());
    let end = end.ok_or_else(|| fault("names more bytes than it has; export it again"))?;
    Ok((&rest[..json], &rest[json..end]))
}

impl Views for Buffers<'_> {
    fn view(&self, index: u64) -> Result<Vec<u8>, TilesError> {
        let item = |key: &str, index: u64| -> Result<At, TilesError> {
            let list = self.json.need(key)?;
            let found = usize::try_from(index)
                .ok()
                .and_then(|i| list.items().ok()?.nth(i));
            found.ok_or_else(|| list.fault(format!("has no element {index}")))
        };
        let view = item("bufferViews", index)?;
        let whole = |at: At| at.whole(0, u64::MAX);
        let buffer = whole(view.need("buffer")?)?;
        let start = view.get("byteOffset").map_or(Ok(0), whole)?;
        let length = whole(view.need("byteLength")?)?;
        let at = item("buffers", buffer)?;
        let fetched;
        let bytes = match at.get("uri") {
            None if buffer == 0 => self.own,
            None => return Err(at.fault("has no 'uri'; only the first buffer may do without")),
            Some(uri) => {
                fetched = self.fetcher.read(&resolve(at.location, uri.text()?)?)?;
                &fetched[..]
            }
        };
        let range = usize::try_from(start)
            .ok()
            .zip(usize::try_from(length).ok());
        let part = range.and_then(|(start, length)| bytes.get(start..start.checked_add(length)?));
        let part = part.ok_or_else(|| {
            view.fault(format!(
                "reaches beyond its buffer of {} bytes",
                bytes.len()
            ))
        })?;
        Ok(part.to_vec())
    }
}

impl Buffers<'_> {
    /// An availability of so many things.
    fn availability(&self, at: &At, things: Option<u64>) -> Result<Availability, TilesError> {
        at.object()?;
        if let Some(constant) = at.get("constant") {
            return Ok(Availability::Constant(constant.whole(0, 1)? == 1));
        }
        let stream = at.get("bitstream").or_else(|| at.get("bufferView"));
        let stream =
            stream.ok_or_else(|| at.fault("has neither 'bitstream' nor 'constant'; add one"))?;
        let bytes = self.view(stream.whole(0, u64::MAX)?)?;
        let enough = things.is_some_and(|things| bytes.len() as u64 >= things.div_ceil(8));
        if !enough {
            let have = bytes.len() * 8;
            return Err(stream.fault(format!(
                "has {have} bits, fewer than there are tiles to tell of"
            )));
        }
        Ok(Availability::Bits(bytes))
    }
}

/// What a subtree says.
struct Subtree<'a> {
    tiles: Availability,
    contents: Vec<Availability>,
    children: Availability,
    table: Option<Table>,
    json: At<'a>,
}

impl<'a> Subtree<'a> {
    fn read(buffers: &Buffers<'a>, tiling: &Tiling) -> Result<Self, TilesError> {
        let json = &buffers.json;
        let whole = tiling.scheme.tree_tiles(tiling.subtree_levels);
        let below = tiling.scheme.level_tiles(tiling.subtree_levels);
        let tiles = buffers.availability(&json.need("tileAvailability")?, whole)?;
        let contents = match json.get("contentAvailability") {
            // Drafts have a single one.
            Some(one) if one.value.is_object() => vec![buffers.availability(&one, whole)?],
            Some(several) => {
                let several = several.items()?.take(tiling.contents.len().max(1));
                several
                    .map(|one| buffers.availability(&one, whole))
                    .collect::<Result<_, _>>()?
            }
            None => Vec::new(),
        };
        let children = buffers.availability(&json.need("childSubtreeAvailability")?, below)?;
        let table = match (&tiling.schema, json.get("tileMetadata")) {
            (Some(schema), Some(number)) => Table::read(buffers, json, schema, &number)?,
            _ => None,
        };
        Ok(Self {
            tiles,
            contents,
            children,
            table,
            json: json.clone(),
        })
    }
}

/// The tiles of a subtree that a tile roots.
pub(super) fn subtree(
    fetcher: &Fetcher,
    location: &str,
    bytes: &[u8],
    tiling: &Arc<Tiling>,
    root: Coordinates,
) -> Result<Expansion, TilesError> {
    let (json, own) = split(location, bytes)?;
    let value: Value = parse(location, json)?;
    let buffers = Buffers {
        fetcher,
        json: At::root(location, &value),
        own,
    };
    let subtree = Subtree::read(&buffers, tiling)?;
    if !subtree.tiles.has(0) {
        return Err(subtree
            .json
            .fault("has no root: its first tile must be available"));
    }
    let mut grown = Grown {
        subtree,
        tiling,
        tiles: Vec::new(),
        before: (0, 0),
    };
    // The root is a tile already; here it stands in for it.
    let first = grown.tile(root, Some(0))?;
    grown.tiles.push(first);
    let mut level = vec![(0, 0)];
    for depth in 0..tiling.subtree_levels {
        let mut next = Vec::new();
        for (i, morton) in level {
            let start = grown.tiles.len();
            let children = grown.children(root, depth, morton)?;
            for child in children {
                if child.inside {
                    next.push((grown.tiles.len(), child.morton));
                }
                grown.tiles.push(child.tile);
            }
            let external = std::mem::take(&mut grown.tiles[i].1);
            for uri in external {
                let leading = grown.tiles[i].0.leading_to(uri);
                grown.tiles.push((leading, Vec::new()));
            }
            if grown.tiles.len() > MOST_TILES {
                return Err(grown.subtree.json.fault(format!(
                    "has more than {MOST_TILES} tiles; make it with fewer levels"
                )));
            }
            grown.tiles[i].0.children = start..grown.tiles.len();
        }
        level = next;
    }
    let mut tiles = grown.tiles.into_iter().map(|(loose, _)| loose);
    let first = tiles.next().ok_or_else(|| buffers.json.fault("is empty"))?;
    let down =
        |range: std::ops::Range<usize>| range.start.saturating_sub(1)..range.end.saturating_sub(1);
    let roots = down(first.children);
    let tiles = tiles.map(|loose| Loose {
        children: down(loose.children.clone()),
        ..loose
    });
    Ok(Expansion {
        tiles: tiles.collect(),
        roots,
        contents: first.tile.contents,
        facts: first.facts,
        file: None,
    })
}

/// What contradicts itself in a subtree that can be read.
pub(super) fn contradictions(
    fetcher: &Fetcher,
    location: &str,
    bytes: &[u8],
    tiling: &Tiling,
) -> Result<Vec<TilesError>, TilesError> {
    let (json, own) = split(location, bytes)?;
    let value: Value = parse(location, json)?;
    let at = At::root(location, &value);
    let mut found = Vec::new();
    if bytes.starts_with(b"subt") {
        if json.len() % 8 != 0 || own.len() % 8 != 0 {
            found.push(at.fault("has parts that are no multiples of 8 bytes; pad them"));
        }
        if bytes.len() != 24 + json.len() + own.len() {
            found.push(at.fault("has another length than its header says; export it again"));
        }
    }
    let buffers = Buffers {
        fetcher,
        json: at.clone(),
        own,
    };
    let subtree = Subtree::read(&buffers, tiling)?;
    let whole = tiling.scheme.tree_tiles(tiling.subtree_levels);
    let below = tiling.scheme.level_tiles(tiling.subtree_levels);
    let (Some(whole), Some(below)) = (whole, below) else {
        return Ok(found);
    };
    let counted = |at: Option<At>, availability: &Availability, things: u64| {
        let at = at?;
        if let (Some(said), Availability::Bits(bits)) = (at.get("availableCount"), availability) {
            let count = availability.count(things);
            if said.value.as_u64() != Some(count) {
                return Some(said.fault(format!(
                    "differs from the {count} bits that are set; write {count}"
                )));
            }
            if bits.len() as u64 > things.div_ceil(8) {
                let stream = at.get("bitstream")?;
                return Some(stream.fault(format!(
                    "has more bytes than {things} bits need; shorten it"
                )));
            }
        }
        None
    };
    found.extend(counted(at.get("tileAvailability"), &subtree.tiles, whole));
    found.extend(counted(
        at.get("childSubtreeAvailability"),
        &subtree.children,
        below,
    ));
    // Constants promise too much to be looked through one by one.
    let few = whole.min(1 << 20);
    if let (Some(all), Availability::Bits(_)) = (at.get("contentAvailability"), &subtree.tiles) {
        let each = all.items().ok().into_iter().flatten();
        for (at, availability) in each.zip(&subtree.contents) {
            found.extend(counted(Some(at.clone()), availability, whole));
            let listed = matches!(availability, Availability::Bits(_));
            let lonely =
                (0..few).find(|i| listed && availability.has(*i) && !subtree.tiles.has(*i));
            found.extend(lonely.map(|i| {
                at.fault(format!(
                    "has content {i}, whose tile is not available; take it out"
                ))
            }));
        }
    }
    if matches!(subtree.tiles, Availability::Bits(_)) {
        let fan = 1 << tiling.scheme.dimensions();
        let orphan = (1..few).find(|i| subtree.tiles.has(*i) && !subtree.tiles.has((i - 1) / fan));
        found.extend(orphan.map(|i| {
            let parent = (i - 1) / fan;
            at.fault(format!(
                "tileAvailability has tile {i} without its parent {parent}; add the parent"
            ))
        }));
    }
    Ok(found)
}

struct Grown<'a> {
    subtree: Subtree<'a>,
    tiling: &'a Arc<Tiling>,
    tiles: Vec<Grain>,
    /// Tiles available before an index: the row of its metadata.
    before: (u64, u64),
}

/// A tile, and what external tilesets it leads to beside its own contents.
type Grain = (Loose, Vec<String>);

/// A child, its place in Morton order among all of its level, and whether it stands in the same subtree.
struct Child {
    tile: Grain,
    morton: u64,
    inside: bool,
}

impl Grown<'_> {
    /// The children of a tile `depth` levels below the subtree's root.
    fn children(
        &mut self,
        root: Coordinates,
        depth: u32,
        morton: u64,
    ) -> Result<Vec<Child>, TilesError> {
        let (tiling, scheme) = (self.tiling.clone(), self.tiling.scheme);
        let mut children = Vec::new();
        if root.level + depth + 1 >= tiling.available_levels {
            return Ok(children);
        }
        let inside = depth + 1 < tiling.subtree_levels;
        let offset = scheme.tree_tiles(depth + 1);
        let offset = offset.filter(|_| inside).unwrap_or(0);
        for k in 0..1 << scheme.dimensions() {
            let child = morton << scheme.dimensions() | k;
            let place = root.descendant(scheme, depth + 1, child);
            if inside && self.subtree.tiles.has(offset + child) {
                let tile = self.tile(place, Some(offset + child))?;
                children.push(Child {
                    tile,
                    morton: child,
                    inside,
                });
            } else if !inside && self.subtree.children.has(child) {
                let (mut loose, _) = self.tile(place, None)?;
                loose.tile.unread = Some(resolve(&tiling.base, &place.fill(&tiling.subtrees))?);
                loose.wait = Some(Wait::Subtree(tiling.clone(), place));
                let tile = (loose, Vec::new());
                children.push(Child {
                    tile,
                    morton: child,
                    inside,
                });
            }
        }
        Ok(children)
    }

    /// A tile by its place; `index`: that in the subtree, `None` for one that roots a subtree of its own.
    fn tile(&mut self, place: Coordinates, index: Option<u64>) -> Result<Grain, TilesError> {
        let tiling = self.tiling;
        let mut tile = Tile {
            volume: place.volume(tiling.scheme, &tiling.volume),
            viewer_request_volume: None,
            geometric_error_m: tiling.error_m * (-f64::from(place.level)).exp2(),
            refine: tiling.refine,
            to_root_m: tiling.to_root_m,
            contents: Vec::new(),
            unread: None,
        };
        let Some(index) = index else {
            return Ok((Loose::new(tile), Vec::new()));
        };
        if self.subtree.table.is_some() {
            let row = self.row(index);
            if let Some(table) = &self.subtree.table {
                table
                    .apply(row, &mut tile)
                    .map_err(|fault| self.subtree.json.fault(fault))?;
            }
        }
        let available = self.subtree.contents.iter().zip(&tiling.contents);
        let contents: Vec<String> = available
            .filter(|(available, _)| available.has(index))
            .map(|(_, template)| resolve(&tiling.base, &place.fill(template)))
            .collect::<Result<_, _>>()?;
        let mut loose = Loose::new(tile);
        let external = loose.take_contents(contents, true);
        Ok((loose, external))
    }

    /// How many tiles are available before an index; indices only grow.
    fn row(&mut self, index: u64) -> u64 {
        let (from, count) = self.before;
        let more = match &self.subtree.tiles {
            Availability::Constant(_) => index - from.min(index),
            bits => (from..index).map(|i| u64::from(bits.has(i))).sum(),
        };
        self.before = (index, count + more);
        count + more
    }
}

#[cfg(test)]
mod tests;
