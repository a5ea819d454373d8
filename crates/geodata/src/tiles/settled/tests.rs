use super::*;
use boresight_models::tiles::volume::{BoundingVolume, Bounds};
use glam::{DAffine3, DMat3, DMat4};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The folder of real tilesets; `None`, with a message, where it is absent.
fn data() -> Option<PathBuf> {
    let folder =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("../shared/data/tiles");
    if !folder.is_dir() {
        println!("skipped: no ../shared/data/tiles");
        return None;
    }
    Some(folder)
}

fn mars(name: &str) -> Option<Tileset> {
    let file = data()?.join("mars-terrain/example/public/data").join(name);
    Some(Tileset::open(file.to_str().unwrap()).unwrap())
}

fn view(eye: DVec3, towards: DVec3) -> View {
    View {
        r_root_m: eye,
        forward: (towards - eye).try_normalize().unwrap_or(DVec3::X),
        up: DVec3::Y,
        fovy_rad: 60f64.to_radians(),
        size_px: [1920, 1080],
    }
}

const ALL: SelectOptions = SelectOptions {
    max_error_px: 16.0,
    cull: false,
};

fn above_mars(tileset: &Tileset, distance_m: f64) -> View {
    let center = tileset.tree.bounds(TileId(0)).center_m;
    view(center + DVec3::new(0.0, 0.0, distance_m), center)
}

#[test]
fn mars_at_the_check_values() {
    let Some(mut tileset) = mars("tileset.json") else {
        return;
    };
    for (distance_m, tiles, triangles) in [
        (200.0, 88, 89_736),
        (1000.0, 28, 38_287),
        (3000.0, 1, 1_966),
    ] {
        let views = [above_mars(&tileset, distance_m)];
        let cut = settle(&mut tileset, &views, &ALL).unwrap();
        assert_eq!(cut.draw.len(), tiles, "{distance_m} m");
        let loaded = load(&mut tileset, &|tree| ideal_cut(tree, &views, &ALL)).unwrap();
        let found: usize = loaded
            .iter()
            .map(|(_, content)| content.triangle_count())
            .sum();
        assert_eq!(found, triangles, "{distance_m} m");
    }
    assert!(tileset.failures().is_empty());
    let mut add = mars("tileset-add.json").unwrap();
    let views = [above_mars(&add, 200.0)];
    assert_eq!(settle(&mut add, &views, &ALL).unwrap().draw.len(), 117);
}

/// What is drawn, by the locations of its contents.
fn drawn(tileset: &Tileset, cut: &Cut) -> Vec<String> {
    let contents = cut
        .draw
        .iter()
        .flat_map(|tile| tileset.tree.tile(*tile).contents.clone());
    let mut contents: Vec<String> = contents.collect();
    contents.sort();
    contents
}

#[test]
fn mars_in_several_files_is_the_same_mars() {
    let Some(mut whole) = mars("tileset.json") else {
        return;
    };
    for name in [
        "tileset-external.json",
        "tileset-external-with-url-params.json",
    ] {
        let mut parts = mars(name).unwrap();
        for distance_m in [150.0, 200.0, 600.0, 1000.0] {
            let views = [above_mars(&whole, distance_m)];
            let (a, b) = (
                settle(&mut whole, &views, &ALL).unwrap(),
                settle(&mut parts, &views, &ALL).unwrap(),
            );
            assert_eq!(drawn(&whole, &a), drawn(&parts, &b), "{name} {distance_m}");
        }
        // The inner file does not say which axis is up; the outer one does.
        assert_eq!(parts.files().len(), 2);
        assert_eq!(parts.files()[1].up_axis, content::UpAxis::Z);
    }
}

#[test]
fn what_cannot_be_read_is_told_once_and_leaves_the_parent() {
    let Some(mut broken) = mars("tileset-external-broken.json") else {
        return;
    };
    let views = [above_mars(&broken, 200.0)];
    let cut = settle(&mut broken, &views, &ALL).unwrap();
    settle(&mut broken, &views, &ALL).unwrap();
    assert_eq!(broken.failures().len(), 1);
    assert!(
        broken.failures()[0]
            .1
            .to_string()
            .contains("nonexistent.json")
    );
    let parent = drawn(&broken, &cut)
        .into_iter()
        .find(|uri| uri.ends_with("/0.b3dm"));
    assert!(parent.is_some(), "{:?}", drawn(&broken, &cut));

    // A root without its content: children stand in for it, near and far.
    let mut broken = mars("tileset-broken-root-content.json").unwrap();
    let views = [above_mars(&broken, 3000.0)];
    let loaded = load(&mut broken, &|tree| ideal_cut(tree, &views, &ALL)).unwrap();
    assert_eq!((loaded.len(), broken.failures().len()), (4, 1));
}

#[test]
fn a_fixed_level_of_detail_of_mars() {
    let Some(mut tileset) = mars("tileset.json") else {
        return;
    };
    let center = tileset.tree.bounds(TileId(0)).center_m;
    let all = finest(&mut tileset, center, 1e4, 0.0).unwrap();
    let leaves = (0..tileset.tree.tiles().len() as u32)
        .filter(|i| tileset.tree.children(TileId(*i)).next().is_none());
    assert_eq!(all.draw.len(), leaves.count());
    let near = finest(&mut tileset, center, 20.0, 0.0).unwrap();
    assert!(!near.draw.is_empty() && near.draw.len() < all.draw.len() / 4);
    assert_eq!(
        finest(&mut tileset, center, 1e4, 31.0).unwrap().draw,
        [TileId(0)]
    );
}

/// A tileset read and walked by other means: JSON alone, one file into the other, bits by shifting.
struct Reference {
    volume: BoundingVolume,
    to_root: DAffine3,
    error_m: f64,
    add: bool,
    request: Option<BoundingVolume>,
    always: bool,
    contents: Vec<String>,
    children: Vec<Reference>,
    lost: bool,
}

impl Reference {
    fn open(file: &Path, to_root: DAffine3, add: bool) -> Option<Self> {
        let json: Value = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
        Some(Self::tile(file, &json["root"], to_root, add))
    }

    fn volume(json: &Value) -> BoundingVolume {
        let numbers = |name: &str| -> Option<Vec<f64>> {
            Some(
                json.get(name)?
                    .as_array()?
                    .iter()
                    .map(|n| n.as_f64().unwrap())
                    .collect(),
            )
        };
        if let Some(n) = numbers("box") {
            let half_axes_m = DMat3::from_cols_slice(&n[3..]);
            return BoundingVolume::Box {
                center_m: DVec3::from_slice(&n),
                half_axes_m,
            };
        }
        if let Some(n) = numbers("sphere") {
            return BoundingVolume::Sphere {
                center_m: DVec3::from_slice(&n),
                radius_m: n[3],
            };
        }
        let n = numbers("region").unwrap();
        BoundingVolume::Region {
            west_south_east_north_rad: [n[0], n[1], n[2], n[3]],
            height_m: [n[4], n[5]],
        }
    }

    fn tile(file: &Path, json: &Value, above: DAffine3, add: bool) -> Self {
        let add = json["refine"]
            .as_str()
            .map_or(add, |refine| refine == "ADD");
        let transform: Option<Vec<f64>> =
            (json["transform"].as_array()).map(|m| m.iter().map(|n| n.as_f64().unwrap()).collect());
        let own = transform.map_or(DAffine3::IDENTITY, |m| {
            DAffine3::from_mat4(DMat4::from_cols_slice(&m))
        });
        let mut tile = Self {
            volume: Self::volume(&json["boundingVolume"]),
            to_root: above * own,
            error_m: json["geometricError"].as_f64().unwrap(),
            add,
            request: json.get("viewerRequestVolume").map(Self::volume),
            always: false,
            contents: Vec::new(),
            children: Vec::new(),
            lost: false,
        };
        let contents = json["contents"].as_array().cloned().unwrap_or_default();
        let uris = contents
            .iter()
            .chain(json.get("content"))
            .map(|c| c["uri"].as_str().unwrap().to_string());
        let uris: Vec<String> = uris.collect();
        if json.get("implicitTiling").is_some() {
            tile.implicit(file, &json["implicitTiling"], &uris, [0; 4]);
            return tile;
        }
        for uri in uris {
            if uri.ends_with(".json") {
                tile.always = true;
                match Self::open(&file.parent().unwrap().join(uri), tile.to_root, add) {
                    Some(child) => tile.children.push(child),
                    None => tile.lost = true,
                }
            } else {
                tile.contents.push(uri);
            }
        }
        let children = json["children"].as_array().cloned().unwrap_or_default();
        let children = children
            .iter()
            .map(|child| Self::tile(file, child, tile.to_root, add));
        tile.children.extend(children);
        tile
    }

    /// Fills in a subtree that the tile at [level, x, y, z] roots.
    fn implicit(&mut self, file: &Path, tiling: &Value, contents: &[String], at: [u64; 4]) {
        let name = |template: &str, at: [u64; 4]| {
            let keys = ["{level}", "{x}", "{y}", "{z}"].into_iter().zip(at);
            keys.fold(template.to_string(), |name, (key, n)| {
                name.replace(key, &n.to_string())
            })
        };
        let folder = file.parent().unwrap();
        let path = folder.join(name(tiling["subtrees"]["uri"].as_str().unwrap(), at));
        let bytes = std::fs::read(path).unwrap();
        let length = u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
        let json: Value = serde_json::from_slice(&bytes[24..24 + length]).unwrap();
        let buffer = bytes[24 + length..].to_vec();
        let has = move |availability: &Value, i: u64| match availability["constant"].as_u64() {
            Some(constant) => constant == 1,
            None => {
                let view =
                    &json["bufferViews"][availability["bitstream"].as_u64().unwrap() as usize];
                let start = view["byteOffset"].as_u64().unwrap_or(0);
                buffer[(start + i / 8) as usize] & (1 << (i % 8)) != 0
            }
        };
        let json: Value = serde_json::from_slice(&bytes[24..24 + length]).unwrap();
        let octree = tiling["subdivisionScheme"] == "OCTREE";
        let levels = tiling["subtreeLevels"].as_u64().unwrap();
        let walk = Implicit {
            file,
            tiling,
            contents,
            json: &json,
            has: &has,
            name: &name,
            octree,
            levels,
            root: at,
        };
        walk.fill(self, 0, 0, at);
    }

    fn draw(&self, views: &[View], above: (f64, bool), out: &mut Vec<String>) -> bool {
        let scale = [DVec3::X, DVec3::Y, DVec3::Z]
            .map(|axis| self.to_root.transform_vector3(axis).length());
        let error_m = self.error_m * scale[0].max(scale[1]).max(scale[2]);
        let mut refine = self.always || error_m > above.0;
        let mut seen = false;
        for view in views {
            let far = |volume: &BoundingVolume| {
                Bounds::of(volume, &self.to_root).distance_m(view.r_root_m)
            };
            if self
                .request
                .as_ref()
                .is_some_and(|request| far(request) > 0.0)
            {
                continue;
            }
            seen = true;
            let d = far(&self.volume);
            let error_px =
                error_m * f64::from(view.size_px[1]) / (2.0 * d * (view.fovy_rad / 2.0).tan());
            refine |= d <= 0.0 || error_px >= 16.0;
        }
        if !seen {
            return true;
        }
        if self.lost {
            return false;
        }
        if !refine || self.children.is_empty() {
            out.extend(self.contents.iter().cloned());
            return true;
        }
        let mut below = Vec::new();
        let mut covered = true;
        for child in &self.children {
            covered &= child.draw(views, (error_m, false), &mut below);
        }
        if self.add || (!covered && !self.contents.is_empty()) {
            out.extend(self.contents.iter().cloned());
        }
        if self.add || covered || self.contents.is_empty() {
            out.extend(below);
        }
        self.add || covered || !self.contents.is_empty()
    }
}

/// A subtree on its way into a [`Reference`].
struct Implicit<'a> {
    file: &'a Path,
    tiling: &'a Value,
    contents: &'a [String],
    json: &'a Value,
    has: &'a dyn Fn(&Value, u64) -> bool,
    name: &'a dyn Fn(&str, [u64; 4]) -> String,
    octree: bool,
    levels: u64,
    root: [u64; 4],
}

impl Implicit<'_> {
    fn fill(&self, tile: &mut Reference, depth: u64, morton: u64, at: [u64; 4]) {
        let fan: u64 = if self.octree { 8 } else { 4 };
        let before: u64 = (0..depth).map(|level| fan.pow(level as u32)).sum();
        for (i, content) in self.contents.iter().enumerate() {
            if (self.has)(&self.json["contentAvailability"][i], before + morton) {
                tile.contents.push((self.name)(content, at));
            }
        }
        if at[0] + 1 >= self.tiling["availableLevels"].as_u64().unwrap() {
            return;
        }
        for k in 0..fan {
            let index = morton * fan + k;
            let inside = depth + 1 < self.levels;
            let available = if inside {
                (self.has)(
                    &self.json["tileAvailability"],
                    before + fan.pow(depth as u32) + index,
                )
            } else {
                (self.has)(&self.json["childSubtreeAvailability"], index)
            };
            if !available {
                continue;
            }
            let place = [
                at[0] + 1,
                2 * at[1] + (k & 1),
                2 * at[2] + (k >> 1 & 1),
                2 * at[3] + (k >> 2),
            ];
            let BoundingVolume::Box {
                center_m,
                half_axes_m: h,
            } = tile.volume
            else {
                panic!("a box")
            };
            let side = |bit: u64| if bit == 1 { 0.5 } else { -0.5 };
            let up = if self.octree {
                h.z_axis * side(k >> 2)
            } else {
                DVec3::ZERO
            };
            let center_m = center_m + h.x_axis * side(k & 1) + h.y_axis * side(k >> 1 & 1) + up;
            let z = if self.octree { 0.5 } else { 1.0 };
            let mut child = Reference {
                volume: BoundingVolume::Box {
                    center_m,
                    half_axes_m: DMat3::from_cols(h.x_axis * 0.5, h.y_axis * 0.5, h.z_axis * z),
                },
                error_m: tile.error_m / 2.0,
                contents: Vec::new(),
                children: Vec::new(),
                request: None,
                always: false,
                lost: false,
                ..*tile
            };
            if inside {
                self.fill(&mut child, depth + 1, index, place);
            } else {
                child.implicit(self.file, self.tiling, self.contents, place);
            }
            tile.children.push(child);
        }
        assert!(self.root[0] <= at[0]);
    }
}

#[test]
fn real_tilesets_are_cut_as_an_independent_traversal_cuts_them() {
    let Some(data) = data() else { return };
    let mut files: Vec<PathBuf> = Vec::new();
    let mut folders = vec![data.join("samples"), data.join("mars-terrain")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path
                .file_name()
                .is_some_and(|name| name.to_str().unwrap().starts_with("tileset"))
            {
                files.push(path);
            }
        }
    }
    files.sort();
    let (mut cuts, mut most) = (0, 0);
    for file in files
        .iter()
        .filter(|file| file.extension().is_some_and(|end| end == "json"))
    {
        // Parameters of files are another test's.
        if file.ends_with("tileset-external-with-url-params.json") {
            continue;
        }
        let mut tileset = Tileset::open(file.to_str().unwrap()).unwrap();
        let reference = Reference::open(file, DAffine3::IDENTITY, false).unwrap();
        let bounds = *tileset.tree.bounds(TileId(0));
        for near in [0.0, 1.01, 2.0, 5.0, 20.0, 100.0] {
            for axis in [
                bounds.axes.x_axis,
                bounds.axes.z_axis,
                DVec3::new(0.3, -0.5, 0.8),
            ] {
                let eye = bounds.center_m + axis * near * bounds.radius_m().max(1.0);
                let away = bounds.center_m - axis * 7.0 * bounds.radius_m();
                let views = [
                    view(eye, bounds.center_m),
                    View {
                        fovy_rad: 0.02,
                        ..view(away, bounds.center_m)
                    },
                ];
                let views = &views[..1 + (near > 4.0) as usize];
                let cut = settle(&mut tileset, views, &ALL).unwrap();
                let mut expected = Vec::new();
                reference.draw(views, (f64::INFINITY, false), &mut expected);
                let ends = |uri: &String| uri.rsplit('/').next().unwrap().to_string();
                let mut found: Vec<String> = drawn(&tileset, &cut).iter().map(ends).collect();
                let mut expected: Vec<String> = expected.iter().map(ends).collect();
                found.sort();
                expected.sort();
                assert_eq!(found, expected, "{} at {near}", file.display());
                cuts += 1;
                most = most.max(found.len());
            }
        }
    }
    assert!(
        cuts > 300 && most > 100,
        "{cuts} cuts of up to {most} contents"
    );
}
