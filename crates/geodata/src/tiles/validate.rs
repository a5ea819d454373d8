//! `boresight tiles validate`: what is wrong with a tileset, one line a fault, with its place and its mend.

use crate::tiles::content::Content;
use crate::tiles::error::TilesError;
use crate::tiles::json::parse;
use crate::tiles::rules::faults;
use crate::tiles::settled::content;
use crate::tiles::tileset::Tileset;
use boresight_models::shape::textured::PlacedMesh;
use boresight_models::tiles::tree::TileId;
use boresight_models::tiles::volume::Bounds;
use clap::Args;
use std::collections::BTreeSet;

/// What `boresight tiles validate` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// A tileset.json, a folder with one, a .3tz or .zip archive, or an address (http, https).
    pub location: String,
    /// Look at the tree alone, not at what its tiles show.
    #[arg(long)]
    pub no_contents: bool,
    /// The most tiles that are looked at.
    #[arg(long, default_value_t = 100_000)]
    pub most: usize,
}

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Validation {
    /// What is wrong.
    pub faults: Vec<TilesError>,
    /// How many tiles and contents were looked at.
    pub looked_at: [usize; 2],
    /// Tiles that lead to what was not read.
    pub unread: usize,
}

impl Validation {
    /// 0: nothing is wrong; 1: something is. What cannot be opened at all is an error: 2.
    pub fn exit_code(&self) -> u8 {
        u8::from(!self.faults.is_empty())
    }

    /// A line a fault, and the sum.
    pub fn text(&self) -> String {
        let mut text: String = self
            .faults
            .iter()
            .map(|fault| format!("{fault}\n"))
            .collect();
        let [tiles, contents] = self.looked_at;
        let rest = match self.unread {
            0 => String::new(),
            n => format!(", {n} tiles lead to more that was not looked at (--most)"),
        };
        let verdict = match self.faults.len() {
            0 => "no fault".into(),
            1 => "1 fault".into(),
            n => format!("{n} faults"),
        };
        text += &format!("{verdict} in {tiles} tiles with {contents} contents{rest}");
        text
    }
}

/// Looks at a tileset: its files, its subtrees, and, unless told not to, its contents.
pub fn validate(args: &Arguments) -> Result<Validation, TilesError> {
    let mut tileset = Tileset::open(&args.location)?;
    let mut found = Validation::default();
    let mut files = 0;
    let mut i = 0;
    while i < tileset.tree.tiles().len() && i < args.most {
        let tile = TileId(i as u32);
        if let Some(request) = tileset.request(tile) {
            found.faults.extend(request.contradictions());
            // A failure is kept in the tileset.
            let _ = tileset.expand(tile);
        }
        // Files as they come, so that faults stand in the order of the tree.
        for file in &tileset.files()[files..] {
            let bytes = tileset.fetcher().read(&file.location)?;
            found
                .faults
                .extend(faults(&file.location, &parse(&file.location, &bytes)?));
        }
        files = tileset.files().len();
        i += 1;
    }
    found.looked_at[0] = i;
    let unread = tileset
        .tree
        .tiles()
        .iter()
        .filter(|tile| tile.unread.is_some());
    found.unread = unread.count();
    found
        .faults
        .extend(tileset.failures().iter().map(|(_, error)| error.clone()));
    if !args.no_contents {
        let mut seen = BTreeSet::new();
        for i in 0..i {
            let tile = TileId(i as u32);
            let contents = &tileset.tree.tile(tile).contents;
            if contents.is_empty() || !contents.iter().any(|uri| seen.insert(uri.clone())) {
                continue;
            }
            found.looked_at[1] += contents.len();
            match content(&tileset, tile) {
                Ok(content) => found.faults.extend(outside(&tileset, tile, &content)),
                Err(error) => found.faults.push(error),
            }
        }
    }
    // Two ways to the same fault are one fault.
    let mut told = BTreeSet::new();
    found.faults.retain(|fault| told.insert(fault.to_string()));
    Ok(found)
}

/// Tells where a content stands out of its tile's volume: it would vanish while it is in the picture.
fn outside(tileset: &Tileset, tile: TileId, content: &Content) -> Option<TilesError> {
    let here = tileset.tree.tile(tile);
    let bounds: &Bounds = tileset.tree.bounds(tile);
    let over = |placed: &PlacedMesh| {
        let mut most_m = 0.0f64;
        for placement in &placed.placements {
            let to_root_m = here.to_root_m * *placement;
            for index in 0..placed.mesh.positions.len() as u32 {
                let point_m = to_root_m.transform_point3(placed.mesh.vertex_m(index));
                most_m = most_m.max(bounds.distance_m(point_m));
            }
        }
        most_m
    };
    let over_m = content.meshes.iter().map(over).fold(0.0, f64::max);
    // Writers round; half a percent of the tile hides nothing.
    (over_m > 5e-3 * bounds.radius_m() + 1e-3).then(|| TilesError::Format {
        location: here.contents.join(" + "),
        place: "positions".into(),
        fault: format!("stand up to {over_m:.2} m out of the tile's bounding volume; enlarge it"),
    })
}

#[cfg(test)]
mod tests;
