//! The textures of a tile in one picture.
//!
//! Vertices keep their places in the source's textures through all levels, so that a tile's atlas is cut from the source
//! itself, at the tile's resolution: nothing is resampled twice, and children weld without seams.

use super::mesh::{Material, Mesh, Scene, Sets};
use super::pictures::LINEAR;
use boresight_models::shape::textured::Texture;
use glam::DVec3;

/// Pixels around a chart that continue its picture.
const GUTTER_PX: i64 = 2;
/// Charts that fill this share of the rectangle around them are kept together in it.
const DENSE: f64 = 0.7;

/// A tile's picture.
#[derive(Debug)]
pub(super) struct Atlas {
    pub texture: Texture,
    /// Place of each vertex of the mesh in it.
    pub uv: Vec<[f32; 2]>,
    /// Side of a pixel on the surface [steps of the lattice].
    pub texel: f64,
    /// How often the source's textures are halved in it.
    pub halvings: u32,
}

/// A rectangle of a source's texture.
#[derive(Clone, Copy, Debug)]
struct Rect {
    texture: usize,
    wraps: bool,
    low: [i64; 2],
    high: [i64; 2],
    /// Where it lies in the atlas.
    to: [i64; 2],
}

impl Rect {
    fn size(&self) -> [i64; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    fn area(&self) -> f64 {
        self.size()[0] as f64 * self.size()[1] as f64
    }

    fn joined(self, other: Self) -> Self {
        Self {
            low: [0, 1].map(|k| self.low[k].min(other.low[k])),
            high: [0, 1].map(|k| self.high[k].max(other.high[k])),
            ..self
        }
    }
}

/// Whether a material's texture goes into the atlas.
fn of_atlas(material: &Material) -> Option<usize> {
    material.texture.filter(|_| !material.tiled)
}

/// The atlas of a tile, at the given halving of its textures or, where that does not fit, at the next that does; `None`
/// without textures, or with too many charts.
pub(super) fn pack(scene: &Scene, mesh: &Mesh, halvings: u32, max_px: u32) -> Option<Atlas> {
    let material = |i: u32| &scene.materials[mesh.vertices[i as usize].material as usize];
    let mut sets = Sets::new(mesh.vertices.len());
    let mut textured = Vec::new();
    for triangle in mesh.triangles() {
        if of_atlas(material(triangle[0])).is_some() {
            sets.join(triangle[0], triangle[1]);
            sets.join(triangle[0], triangle[2]);
            textured.push(*triangle);
        }
    }
    if textured.is_empty() {
        return None;
    }
    // Which chart each vertex is of.
    let mut chart_of = vec![usize::MAX; mesh.vertices.len()];
    let mut charts: Vec<Vec<u32>> = Vec::new();
    for &i in textured.as_flattened() {
        let root = sets.root(i) as usize;
        if chart_of[root] == usize::MAX {
            chart_of[root] = charts.len();
            charts.push(Vec::new());
        }
        let chart = chart_of[root];
        charts[chart].push(i);
        chart_of[i as usize] = chart;
    }
    let deepest = (scene.textures.iter().map(|t| t.halvings()).max()).unwrap_or_default();
    (halvings..=deepest.max(halvings)).find_map(|halvings| {
        let rect = |chart: &Vec<u32>| -> Option<Rect> {
            let material = material(*chart.first()?);
            let texture = of_atlas(material)?;
            let size = scene.textures[texture].at(halvings).size_px.map(f64::from);
            let px = |i: &u32, k: usize| f64::from(mesh.vertices[*i as usize].uv[k]) * size[k];
            let least = |k| chart.iter().map(|i| px(i, k)).fold(f64::INFINITY, f64::min);
            let most = |k| (chart.iter().map(|i| px(i, k))).fold(f64::NEG_INFINITY, f64::max);
            Some(Rect {
                texture,
                wraps: material.wraps,
                low: [0, 1].map(|k| least(k).floor() as i64 - GUTTER_PX),
                high: [0, 1]
                    .map(|k| (most(k).ceil() as i64).max(least(k).floor() as i64 + 1) + GUTTER_PX),
                to: [0; 2],
            })
        };
        let rects: Vec<Rect> = charts.iter().filter_map(rect).collect();
        let (mut rects, place_of) = together(&rects);
        let size = place(&mut rects, i64::from(max_px))?;
        Some(fill(
            scene,
            mesh,
            halvings,
            &textured,
            &rects,
            size,
            |vertex| place_of.get(chart_of[vertex]).copied(),
        ))
    })
}

/// Charts of one texture that lie close together as one; and which rectangle each chart is now in.
fn together(rects: &[Rect]) -> (Vec<Rect>, Vec<usize>) {
    let mut order: Vec<usize> = (0..rects.len()).collect();
    order.sort_by_key(|&i| (rects[i].texture, rects[i].wraps, i));
    let mut all = Vec::new();
    let mut place_of = vec![0; rects.len()];
    for same in order
        .chunk_by(|&a, &b| (rects[a].texture, rects[a].wraps) == (rects[b].texture, rects[b].wraps))
    {
        let whole = same.iter().map(|&i| rects[i]).reduce(Rect::joined);
        let sum: f64 = same.iter().map(|&i| rects[i].area()).sum();
        if let Some(whole) = whole.filter(|whole| sum >= DENSE * whole.area()) {
            for &i in same {
                place_of[i] = all.len();
            }
            all.push(whole);
        } else {
            for &i in same {
                place_of[i] = all.len();
                all.push(rects[i]);
            }
        }
    }
    (all, place_of)
}

/// Puts rectangles on shelves, the highest first; the size of the whole, or `None` if it is too large.
fn place(rects: &mut [Rect], max_px: i64) -> Option<[i64; 2]> {
    let mut order: Vec<usize> = (0..rects.len()).collect();
    order.sort_by_key(|&i| (-rects[i].size()[1], -rects[i].size()[0], i));
    let area: f64 = rects.iter().map(Rect::area).sum();
    let widest = rects.iter().map(|r| r.size()[0]).max().unwrap_or(1);
    let width = widest.max(area.sqrt().ceil() as i64);
    let (mut x, mut y, mut shelf) = (0, 0, 0);
    for i in order {
        let [w, h] = rects[i].size();
        if x + w > width {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        rects[i].to = [x, y];
        x += w;
        shelf = shelf.max(h);
    }
    let height = y + shelf;
    (width <= max_px && height <= max_px).then_some([width, height])
}

/// Copies the rectangles' pixels, and says where vertices lie now.
fn fill(
    scene: &Scene,
    mesh: &Mesh,
    halvings: u32,
    textured: &[[u32; 3]],
    rects: &[Rect],
    size: [i64; 2],
    rect_of: impl Fn(usize) -> Option<usize>,
) -> Atlas {
    let mut rgba = vec![0; 4 * (size[0] * size[1]) as usize];
    for pixel in rgba.as_chunks_mut::<4>().0 {
        pixel[3] = 255;
    }
    for rect in rects {
        let source = scene.textures[rect.texture].at(halvings);
        let [w, h] = source.size_px.map(i64::from);
        let fold = |x: i64, side: i64| match rect.wraps {
            true => x.rem_euclid(side),
            false => x.clamp(0, side - 1),
        };
        for y in rect.low[1]..rect.high[1] {
            for x in rect.low[0]..rect.high[0] {
                let from = (4 * (fold(y, h) * w + fold(x, w))) as usize;
                let row = rect.to[1] + y - rect.low[1];
                let to = (4 * (row * size[0] + rect.to[0] + x - rect.low[0])) as usize;
                rgba[to..to + 4].copy_from_slice(&source.rgba[from..from + 4]);
            }
        }
    }
    let mut uv = vec![[0.0; 2]; mesh.vertices.len()];
    let mut sources = vec![[1.0; 2]; mesh.vertices.len()];
    for (i, vertex) in mesh.vertices.iter().enumerate() {
        let Some(rect) = rect_of(i).map(|r| rects[r]) else {
            continue;
        };
        let source = scene.textures[rect.texture]
            .at(halvings)
            .size_px
            .map(f64::from);
        sources[i] = source;
        uv[i] = std::array::from_fn(|k| {
            let px = f64::from(vertex.uv[k]) * source[k] - rect.low[k] as f64 + rect.to[k] as f64;
            (px / size[k] as f64) as f32
        });
    }
    let (mut surface, mut pixels) = (0.0, 0.0);
    for triangle in textured {
        let [a, b, c] = triangle.map(|i| mesh.vertices[i as usize]);
        let [p, q] = [b, c]
            .map(|v| DVec3::from_array(std::array::from_fn(|k| f64::from(v.at[k] - a.at[k]))));
        surface += p.cross(q).length();
        let [w, h] = sources[triangle[0] as usize];
        let [u, v] = [b, c].map(|p| [0, 1].map(|k| f64::from(p.uv[k] - a.uv[k])));
        pixels += (u[0] * v[1] - u[1] * v[0]).abs() * w * h;
    }
    Atlas {
        texture: Texture {
            size_px: size.map(|side| side as u32),
            rgba,
        },
        uv,
        texel: if pixels > 0.0 {
            (surface / pixels).sqrt()
        } else {
            0.0
        },
        halvings,
    }
}

/// The mesh with the colours of its textures at its vertices, in place of those textures of which `which` says so. The
/// colour is that of the texture after so many halvings.
pub(super) fn painted(
    scene: &Scene,
    mesh: &Mesh,
    halvings: u32,
    which: impl Fn(&Material) -> bool,
) -> Mesh {
    let mut mesh = mesh.clone();
    for vertex in &mut mesh.vertices {
        let material = &scene.materials[vertex.material as usize];
        let Some(texture) = material.texture.filter(|_| which(material)) else {
            continue;
        };
        let texture = scene.textures[texture].at(halvings);
        let place = |k: usize| {
            let side = texture.size_px[k];
            let x = if material.tiled || material.wraps {
                vertex.uv[k].rem_euclid(1.0)
            } else {
                vertex.uv[k].clamp(0.0, 1.0)
            };
            ((f64::from(x) * f64::from(side)) as u32).min(side - 1) as usize
        };
        let at = 4 * (place(1) * texture.size_px[0] as usize + place(0));
        for c in 0..3 {
            let factor = LINEAR[texture.rgba[at + c] as usize];
            vertex.color[c] = (f32::from(vertex.color[c]) * factor).round() as u16;
        }
        vertex.uv = [0.0; 2];
        vertex.material = material.plain;
    }
    mesh.welded()
}

/// Side of what a repeating texture shows on the surface [steps of the lattice]: pixels of its coarsest halving that is
/// still no uniform colour.
pub(super) fn detail(scene: &Scene, mesh: &Mesh) -> f64 {
    let mut side = 0.0_f64;
    for (index, material) in scene.materials.iter().enumerate() {
        let Some(texture) = material.texture.filter(|_| material.tiled) else {
            continue;
        };
        let (mut surface, mut turns) = (0.0, 0.0);
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.map(|i| mesh.vertices[i as usize]);
            if a.material as usize != index {
                continue;
            }
            let [p, q] = [b, c]
                .map(|v| DVec3::from_array(std::array::from_fn(|k| f64::from(v.at[k] - a.at[k]))));
            surface += p.cross(q).length();
            let [u, v] = [b, c].map(|p| [0, 1].map(|k| f64::from(p.uv[k] - a.uv[k])));
            turns += (u[0] * v[1] - u[1] * v[0]).abs();
        }
        if turns > 0.0 {
            let share = uniform_from(&scene.textures[texture]);
            side = side.max((surface / turns).sqrt() * share);
        }
    }
    side
}

/// Side of a pixel of the coarsest halving that is no uniform colour, as a share of the texture's.
fn uniform_from(picture: &super::pictures::Picture) -> f64 {
    /// Deviation of linear light below which nothing is seen.
    const SAME: f32 = 0.02;
    let varied = (0..=picture.halvings()).rev().find(|&k| {
        let (pixels, _) = picture.at(k).rgba.as_chunks::<4>();
        let count = pixels.len() as f32;
        let light = |p: &[u8; 4]| (0..3).map(|c| LINEAR[p[c] as usize]).sum::<f32>() / 3.0;
        let mean = pixels.iter().map(light).sum::<f32>() / count;
        let spread = pixels
            .iter()
            .map(|p| (light(p) - mean).powi(2))
            .sum::<f32>()
            / count;
        spread.sqrt() > SAME
    });
    varied.map_or(0.0, |k| 1.0 / f64::from(picture.at(k).size_px[0].max(1)))
}
