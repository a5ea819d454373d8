//! `boresight tiles inspect`: the tree of a tileset, and what a camera would load of it.

use crate::tiles::content::{self, Content};
use crate::tiles::error::TilesError;
use crate::tiles::fetch::resolve;
use crate::tiles::settled::settle_by;
use crate::tiles::tileset::Tileset;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::tiles::selection::{Cut, SelectOptions, View, ideal_cut};
use boresight_models::tiles::tree::{Refine, TileId};
use boresight_models::tiles::volume::BoundingVolume;
use clap::Args;
use glam::{DMat3, DVec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// What `boresight tiles inspect` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// A tileset.json, a folder with one, a .3tz or .zip archive, or an address (http, https).
    pub location: String,
    /// Levels of the tree that are printed tile by tile.
    #[arg(long, default_value_t = 1)]
    pub levels: usize,
    /// The most tiles that are read of the tree.
    #[arg(long, default_value_t = 100_000)]
    pub most: usize,
    #[command(flatten)]
    pub camera: Camera,
}

/// The camera that `inspect` looks through.
#[derive(Args, Clone, Debug)]
pub struct Camera {
    /// Where a camera stands: latitude and longitude [°], height above the ellipsoid [m].
    #[arg(long, value_name = "LAT,LON,HEIGHT", value_parser = three, allow_hyphen_values = true)]
    pub at: Option<DVec3>,
    /// Where a camera stands in the tileset's own frame [m], for one that is not on the earth.
    #[arg(long, value_name = "X,Y,Z", value_parser = three, allow_hyphen_values = true, conflicts_with = "at")]
    pub at_xyz: Option<DVec3>,
    /// A camera so far above the middle of the whole [m], looking down.
    #[arg(long, value_name = "METRES", conflicts_with_all = ["at", "at_xyz"])]
    pub above: Option<f64>,
    /// Where it looks: azimuth from north by east and elevation [°]; without it, at the middle of the whole.
    #[arg(long, value_name = "AZ,EL", value_parser = two, allow_hyphen_values = true)]
    pub look: Option<[f64; 2]>,
    /// Vertical field of view [°].
    #[arg(long, default_value_t = 60.0, value_parser = field)]
    pub fovy: f64,
    /// Columns and rows of the picture.
    #[arg(long, default_value = "1920x1080", value_name = "COLUMNSxROWS", value_parser = size)]
    pub size: [u32; 2],
    /// A tile refines while its error is this or more [px].
    #[arg(long, default_value_t = 16.0)]
    pub error: f64,
    /// Load what the picture does not show, too.
    #[arg(long)]
    pub no_cull: bool,
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers = text
        .split(',')
        .map(|word| word.trim().parse::<f64>().ok().filter(|n| n.is_finite()));
    let numbers: Option<Vec<f64>> = numbers.collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.ok_or(format!("expected {N} numbers with commas between them"))
}

fn three(text: &str) -> Result<DVec3, String> {
    numbers(text).map(DVec3::from_array)
}

fn two(text: &str) -> Result<[f64; 2], String> {
    numbers(text)
}

fn field(text: &str) -> Result<f64, &'static str> {
    let angle = text
        .parse()
        .ok()
        .filter(|angle| (1e-6..179.0).contains(angle));
    angle.ok_or("expected an angle above 0 and below 179")
}

fn size(text: &str) -> Result<[u32; 2], &'static str> {
    let sides = text
        .split_once('x')
        .and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?]));
    sides
        .filter(|sides| sides.iter().all(|side| (1..=65_536).contains(side)))
        .ok_or("expected 1920x1080 or the like")
}

/// Reads a tileset and says what there is.
pub fn inspect(args: &Arguments) -> Result<String, TilesError> {
    let mut tileset = Tileset::open(&args.location)?;
    let rest = expand_all(&mut tileset, args.most);
    let mut text = summary(&tileset, rest);
    text += &metadata(&tileset);
    text += &levels(&tileset);
    text += &listing(&tileset, args.levels);
    if let Some(view) = view(&tileset, &args.camera) {
        text += &seen(&mut tileset, &view, &args.camera)?;
    }
    for (i, (_, error)) in tileset.failures().iter().enumerate() {
        let head = if i == 0 { "\nnot read\n" } else { "" };
        let _ = writeln!(text, "{head}  {error}");
    }
    Ok(text)
}

/// Reads all of a tree, level by level, until it has so many tiles; what is left unread.
pub(super) fn expand_all(tileset: &mut Tileset, most: usize) -> usize {
    let mut i = 0;
    while i < tileset.tree.tiles().len() && tileset.tree.tiles().len() < most {
        // A failure is kept in the tileset.
        let _ = tileset.expand(TileId(i as u32));
        i += 1;
    }
    let unread = tileset
        .tree
        .tiles()
        .iter()
        .filter(|tile| tile.unread.is_some());
    unread.count()
}

/// A number of bytes as people read it.
fn bytes(n: u64) -> String {
    match n {
        0..1_000 => format!("{n} B"),
        1_000..1_000_000 => format!("{:.1} kB", n as f64 / 1e3),
        _ => format!("{:.1} MB", n as f64 / 1e6),
    }
}

/// A number with a space between thousands.
fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// So many of something.
fn counted(n: usize, what: &str) -> String {
    format!("{} {what}{}", count(n), if n == 1 { "" } else { "s" })
}

/// Whether a point of the root frame is near the earth's surface: whether the tileset is georeferenced.
fn on_earth(point_m: DVec3) -> bool {
    (6.2e6..6.5e6).contains(&point_m.length()) // [m]
}

fn place(point_m: DVec3) -> String {
    if on_earth(point_m) {
        let at = Geodetic::from_ecef(point_m);
        let (lat, lon) = (at.latitude_rad.to_degrees(), at.longitude_rad.to_degrees());
        format!(
            "latitude {lat:.6}°, longitude {lon:.6}°, {:.1} m above the ellipsoid",
            at.height_m
        )
    } else {
        format!(
            "{:.2}, {:.2}, {:.2} m in a frame of its own",
            point_m.x, point_m.y, point_m.z
        )
    }
}

fn summary(tileset: &Tileset, unread: usize) -> String {
    let mut text = String::new();
    let tree = &tileset.tree;
    let Some(file) = tileset.files().first() else {
        return text;
    };
    let root = tree.bounds(TileId(0));
    let kinds = [
        ("box", |v: &BoundingVolume| {
            matches!(v, BoundingVolume::Box { .. })
        }),
        ("sphere", |v: &BoundingVolume| {
            matches!(v, BoundingVolume::Sphere { .. })
        }),
        ("region", |v: &BoundingVolume| {
            matches!(v, BoundingVolume::Region { .. })
        }),
    ] as [(&str, fn(&BoundingVolume) -> bool); 3];
    let kinds =
        kinds.map(|(name, is)| (name, tree.tiles().iter().filter(|t| is(&t.volume)).count()));
    let several = |parts: &[(&str, usize)]| {
        let there = parts.iter().filter(|(_, n)| *n > 0);
        let words: Vec<String> = there
            .map(|(name, n)| format!("{} {name}", count(*n)))
            .collect();
        words.join(", ")
    };
    let refine = |how: Refine| {
        tree.tiles()
            .iter()
            .filter(|tile| tile.refine == how)
            .count()
    };
    let contents: usize = tree.tiles().iter().map(|tile| tile.contents.len()).sum();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<10}{value}");
    };
    line("tileset", file.location.clone());
    line(
        "format",
        format!("3D Tiles {}, glTF with {:?} up", file.version, file.up_axis),
    );
    if !file.extensions.is_empty() {
        line("uses", file.extensions.join(", "));
    }
    if tileset.files().len() > 1 {
        line(
            "files",
            format!("{} tilesets", count(tileset.files().len())),
        );
    }
    line(
        "holds",
        format!(
            "{}, with {}",
            counted(tree.tiles().len(), "tile"),
            counted(contents, "content")
        ),
    );
    if unread > 0 {
        line(
            "",
            format!("{} lead to more that was not read (--most)", count(unread)),
        );
    }
    line("volumes", several(&kinds));
    line(
        "refine",
        several(&[
            ("REPLACE", refine(Refine::Replace)),
            ("ADD", refine(Refine::Add)),
        ]),
    );
    line("middle", place(root.center_m));
    let extent = 2.0 * root.half_m;
    if root.ball {
        line("extent", format!("{:.1} m across", extent.x));
    } else {
        line(
            "extent",
            format!("{:.2} × {:.2} × {:.2} m", extent.x, extent.y, extent.z),
        );
    }
    text
}

/// One line of a metadata entity.
fn entity(value: &Value) -> String {
    /// Properties that are told.
    const TOLD: usize = 12;
    let class = value["class"].as_str().unwrap_or("?");
    let properties = value["properties"].as_object();
    let untold = properties.map_or(0, |all| all.len().saturating_sub(TOLD));
    let pairs = properties
        .into_iter()
        .flatten()
        .take(TOLD)
        .map(|(name, value)| {
            let value = value.to_string();
            let short: String = value.chars().take(40).collect();
            let more = if short.len() < value.len() { "…" } else { "" };
            format!("{name} = {short}{more}")
        });
    let pairs: Vec<String> = pairs.collect();
    let more = match untold {
        0 => String::new(),
        untold => format!(" and {untold} more"),
    };
    format!("{class}: {}{more}", pairs.join(", "))
}

fn metadata(tileset: &Tileset) -> String {
    let mut text = String::new();
    for file in tileset.files() {
        let classes = file
            .schema
            .as_ref()
            .and_then(|schema| schema["classes"].as_object());
        if let Some(classes) = classes {
            let classes: Vec<String> = (classes.iter())
                .map(|(name, class)| {
                    let properties = class["properties"].as_object().map_or(0, |p| p.len());
                    format!("{name} ({properties} properties)")
                })
                .collect();
            let _ = writeln!(text, "{:<10}{}", "schema", classes.join(", "));
        }
        if let Some(own) = &file.metadata {
            let _ = writeln!(text, "{:<10}{}", "metadata", entity(own));
        }
        for (i, group) in file.groups.iter().enumerate() {
            let _ = writeln!(text, "{:<10}{}", format!("group {i}"), entity(group));
        }
    }
    text
}

fn levels(tileset: &Tileset) -> String {
    let tree = &tileset.tree;
    let mut depths: Vec<usize> = Vec::with_capacity(tree.tiles().len());
    let mut rows: BTreeMap<usize, (usize, usize, f64, f64)> = BTreeMap::new();
    for (i, tile) in tree.tiles().iter().enumerate() {
        let id = TileId(i as u32);
        let depth = tree
            .parent(id)
            .map_or(0, |parent| depths[parent.index()] + 1);
        depths.push(depth);
        let row = rows.entry(depth).or_insert((0, 0, f64::INFINITY, 0.0));
        row.0 += 1;
        row.1 += tile.contents.len();
        row.2 = row.2.min(tree.error_m(id));
        row.3 = row.3.max(tree.error_m(id));
    }
    let mut text = format!("\n{:>5} {:>9} {:>9}  error\n", "level", "tiles", "contents");
    for (level, (tiles, contents, least, most)) in rows {
        let range = if least < most {
            format!("{least:.3} to {most:.3} m")
        } else {
            format!("{least:.3} m")
        };
        let _ = writeln!(
            text,
            "{level:>5} {:>9} {:>9}  {range}",
            count(tiles),
            count(contents)
        );
    }
    text
}

/// The last part of a location: enough to know it by.
fn name(location: &str) -> &str {
    location.rsplit('/').next().unwrap_or(location)
}

fn listing(tileset: &Tileset, levels: usize) -> String {
    /// The most lines: more are no overview.
    const LINES: usize = 60;
    let tree = &tileset.tree;
    let mut text = "\ntree\n".to_string();
    let mut waiting = vec![(TileId(0), 0)];
    let (mut lines, mut more) = (0, 0);
    while let Some((id, depth)) = waiting.pop() {
        let children = tree.children(id).count();
        if depth < levels {
            waiting.extend(tree.children(id).rev().map(|child| (child, depth + 1)));
        }
        lines += 1;
        if lines > LINES {
            more += 1;
            continue;
        }
        let tile = tree.tile(id);
        let contents: Vec<&str> = tile.contents.iter().map(|uri| name(uri)).collect();
        let what = match (&tile.unread, contents.is_empty()) {
            (Some(unread), _) => format!("→ {}", name(unread)),
            (None, true) => "no content".into(),
            (None, false) => contents.join(" + "),
        };
        let failed = if tree.failed(id) {
            ", cannot be read"
        } else {
            ""
        };
        let below = if children > 0 {
            format!(", {children} below")
        } else {
            String::new()
        };
        let facts = tileset.facts(id);
        let facts = facts.and_then(|facts| facts.metadata.as_ref()).map(entity);
        let facts = facts.map_or(String::new(), |facts| format!(" [{facts}]"));
        let _ = writeln!(
            text,
            "  {:indent$}{what}: {:.3} m, radius {:.1} m{below}{failed}{facts}",
            "",
            tree.error_m(id),
            tree.bounds(id).radius_m(),
            indent = 2 * depth,
        );
    }
    if more > 0 {
        let _ = writeln!(text, "  … and {} more (--levels)", count(more));
    }
    text
}

/// East, north and up at a point; the axes of a frame that is not on the earth.
fn axes(point_m: DVec3) -> DMat3 {
    if !on_earth(point_m) {
        return DMat3::IDENTITY;
    }
    DMat3::from_quat(SiteFrame::new(Geodetic::from_ecef(point_m)).q_ecef_enu())
}

/// The view that was asked for; `None`: none was.
fn view(tileset: &Tileset, camera: &Camera) -> Option<View> {
    let middle_m = tileset.tree.bounds(tileset.tree.root()?).center_m;
    let eye_m = if let Some(at) = camera.at {
        let at = Geodetic {
            latitude_rad: at.x.to_radians(),
            longitude_rad: at.y.to_radians(),
            height_m: at.z,
        };
        at.to_ecef()
    } else if let Some(at) = camera.at_xyz {
        at
    } else {
        middle_m + camera.above? * axes(middle_m).z_axis
    };
    let axes = axes(eye_m);
    let forward = match camera.look {
        Some([azimuth_deg, elevation_deg]) => {
            let ((sin, cos), (up, level)) = (
                azimuth_deg.to_radians().sin_cos(),
                elevation_deg.to_radians().sin_cos(),
            );
            axes * DVec3::new(sin * level, cos * level, up)
        }
        None => (middle_m - eye_m).try_normalize().unwrap_or(-axes.z_axis),
    };
    let level = forward.cross(axes.z_axis).length() > 1e-6;
    Some(View {
        r_root_m: eye_m,
        forward,
        up: if level { axes.z_axis } else { axes.y_axis },
        fovy_rad: camera.fovy.to_radians(),
        size_px: camera.size,
    })
}

/// What a tile costs.
#[derive(Default)]
struct Cost {
    bytes: u64,
    triangles: usize,
    points: usize,
}

fn cost(tileset: &Tileset, tile: TileId) -> Result<Cost, TilesError> {
    let fetcher = tileset.fetcher();
    let mut cost = Cost::default();
    for location in &tileset.tree.tile(tile).contents {
        let read = fetcher.read(location)?;
        let also = std::cell::Cell::new(0);
        let fetch = |uri: &str| -> Result<Vec<u8>, String> {
            let read = resolve(location, uri).and_then(|location| fetcher.read(&location));
            let read = read.map_err(|error| error.to_string())?;
            also.set(also.get() + read.len() as u64);
            Ok(read)
        };
        let found: Content =
            content::decode(&read, tileset.up_axis(tile), &fetch).map_err(|error| {
                TilesError::Content {
                    location: location.clone(),
                    reason: error.to_string(),
                }
            })?;
        cost.bytes += read.len() as u64 + also.get();
        cost.triangles += found.triangle_count();
        cost.points += found.point_count();
    }
    Ok(cost)
}

fn seen(tileset: &mut Tileset, view: &View, camera: &Camera) -> Result<String, TilesError> {
    let options = SelectOptions {
        max_error_px: camera.error,
        cull: !camera.no_cull,
    };
    let views = [*view];
    let choose = |tree: &_| ideal_cut(tree, &views, &options);
    let mut costs: BTreeMap<TileId, Cost> = BTreeMap::new();
    let cut: Cut = loop {
        let cut = settle_by(tileset, &choose)?;
        let new: Vec<TileId> = cut
            .draw
            .iter()
            .copied()
            .filter(|tile| !costs.contains_key(tile))
            .collect();
        let failures = tileset.failures().len();
        for tile in new {
            match cost(tileset, tile) {
                Ok(cost) => _ = costs.insert(tile, cost),
                Err(error) => tileset.fail(tile, error),
            }
        }
        if tileset.failures().len() == failures {
            break cut;
        }
    };
    let drawn = || cut.draw.iter().filter_map(|tile| costs.get(tile));
    let triangles: usize = drawn().map(|cost| cost.triangles).sum();
    let points: usize = drawn().map(|cost| cost.points).sum();
    let size: u64 = drawn().map(|cost| cost.bytes).sum();
    let [columns, rows] = view.size_px;
    let mut text = format!("\ncamera    {}\n", place(view.r_root_m));
    let _ = writeln!(
        text,
        "          {}° high, {columns} × {rows} px, refines from {} px on{}",
        camera.fovy,
        camera.error,
        if camera.no_cull {
            ", culls nothing"
        } else {
            ""
        }
    );
    let points = if points > 0 {
        format!(", {} points", count(points))
    } else {
        String::new()
    };
    let _ = writeln!(
        text,
        "draws     {}, {}{points}, {} to read",
        counted(cut.draw.len(), "tile"),
        counted(triangles, "triangle"),
        bytes(size)
    );
    let _ = writeln!(
        text,
        "looked at {}, {} of them out of sight",
        counted(cut.visited, "tile"),
        count(cut.culled)
    );
    let mut depths: BTreeMap<usize, usize> = BTreeMap::new();
    for tile in &cut.draw {
        *depths.entry(tileset.tree.depth(*tile)).or_default() += 1;
    }
    let depths: Vec<String> = depths
        .iter()
        .map(|(level, n)| format!("{n} of level {level}"))
        .collect();
    if !depths.is_empty() {
        let _ = writeln!(text, "          {}", depths.join(", "));
    }
    Ok(text)
}
