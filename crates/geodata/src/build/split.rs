//! Cuts a scene into the cells of a quadtree or octree (eq. 4; OGC 22-025r4, implicit tiling).
//!
//! A plane between two cells cuts a triangle once, before its halves go their ways, and an edge is cut from its lesser end
//! whichever triangle asks: both sides get the same vertices, to the bit.

use super::mesh::{FREE, MOST_LEVELS, Mesh, Scene, Vertex};
use glam::Vec3;

/// So many triangles may come of a cut, however few there were.
const FEW: usize = 64;

/// A cell of the tree.
#[derive(Debug, Default)]
pub(super) struct Cell {
    /// 0 for the root.
    pub level: u32,
    /// East, north and (octree) up, counted from the root's low corner.
    pub index: [u32; 3],
    /// Its triangles, where it is cut no further.
    pub mesh: Option<Mesh>,
    /// Its children, as places in the list of cells.
    pub children: Vec<usize>,
}

impl Cell {
    /// Low and high planes of the cell along the axes that are cut.
    pub fn planes(&self, side: i32, axes: usize) -> impl Iterator<Item = (usize, [i32; 2])> {
        let (step, index) = (side >> self.level, self.index);
        (0..axes).map(move |k| (k, [index[k] as i32 * step, (index[k] as i32 + 1) * step]))
    }
}

/// What a cell may hold before it is cut.
pub(super) struct Budget {
    pub triangles: usize,
    /// Pixels of textures.
    pub texels: f64,
    /// Whether cells are cut in height too.
    pub octree: bool,
    /// Whether everything is cut where a cell ends, buildings too.
    pub exact: bool,
}

/// Triangles of a cell, on their way down.
struct Part {
    mesh: Mesh,
    group_of: Vec<u32>,
    cell: usize,
}

/// The cells of a scene, a parent before its children; takes the scene's triangles.
pub(super) fn split(scene: &mut Scene, budget: &Budget) -> Vec<Cell> {
    let mut group_of = std::mem::take(&mut scene.group_of);
    if budget.exact {
        group_of.fill(FREE);
    }
    let mut cells = vec![Cell::default()];
    let mut parts = vec![Part {
        mesh: std::mem::take(&mut scene.mesh),
        group_of,
        cell: 0,
    }];
    while let Some(part) = parts.pop() {
        let level = cells[part.cell].level;
        let many = part.mesh.triangle_count() > budget.triangles;
        let large = texels(scene, &part.mesh) > budget.texels;
        if (many || large) && level < MOST_LEVELS {
            let triangles = part.mesh.triangle_count();
            let children = quarter(scene, &cells[part.cell], &part, budget.octree);
            let counts = || children.iter().map(|(_, part)| part.mesh.triangle_count());
            // Triangles as large as the cell only multiply when they are cut.
            let fewer = counts().all(|count| count < triangles) || children.len() == 1;
            if (large || fewer) && counts().sum::<usize>() <= 2 * triangles + FEW {
                for (index, mut child) in children {
                    child.cell = cells.len();
                    cells[part.cell].children.push(child.cell);
                    cells.push(Cell {
                        level: level + 1,
                        index,
                        ..Cell::default()
                    });
                    parts.push(child);
                }
                continue;
            }
        }
        cells[part.cell].mesh = Some(part.mesh.welded());
    }
    cells
}

/// Pixels of atlases that some triangles use.
fn texels(scene: &Scene, mesh: &Mesh) -> f64 {
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|i| mesh.vertices[i as usize]);
        let material = scene.materials.get(a.material as usize)?;
        let texture = scene
            .textures
            .get(material.texture.filter(|_| !material.tiled)?)?;
        let [w, h] = texture.at(0).size_px.map(f64::from);
        let [u, v] = [b, c].map(|p| [0, 1].map(|k| f64::from(p.uv[k] - a.uv[k])));
        Some(0.5 * (u[0] * v[1] - u[1] * v[0]).abs() * w * h)
    };
    mesh.triangles().iter().filter_map(area).sum()
}

/// The parts of a cell in its children, those that are not empty, in the order of their numbers.
fn quarter(scene: &Scene, cell: &Cell, part: &Part, octree: bool) -> Vec<([u32; 3], Part)> {
    let axes = if octree { 3 } else { 2 };
    let half = scene.side >> (cell.level + 1);
    let mut index = cell.index.map(|i| i * 2);
    if !octree {
        index[2] = 0;
    }
    let cut = |axis: usize, index: [u32; 3], mesh: &Mesh, group_of: &[u32]| {
        let plane = (index[axis] as i32 + 1) * half;
        let [low, high] = halves(mesh, group_of, &scene.groups, axis, plane, half, axes);
        let mut up = index;
        up[axis] += 1;
        [(index, low), (up, high)]
    };
    // The highest axis first: children come in Morton order.
    let mut parts = Vec::from(cut(axes - 1, index, &part.mesh, &part.group_of));
    for axis in (0..axes - 1).rev() {
        parts = (parts.iter())
            .flat_map(|(index, (mesh, group_of))| cut(axis, *index, mesh, group_of))
            .collect();
    }
    parts.retain(|(_, (mesh, _))| !mesh.indices.is_empty());
    (parts.into_iter())
        .map(|(index, (mesh, group_of))| {
            let cell = 0;
            (
                index,
                Part {
                    mesh,
                    group_of,
                    cell,
                },
            )
        })
        .collect()
}

/// One side of a plane, while it fills.
struct Side {
    mesh: Mesh,
    group_of: Vec<u32>,
    moved: Vec<u32>,
}

impl Side {
    fn new(count: usize) -> Self {
        Self {
            mesh: Mesh::default(),
            group_of: Vec::new(),
            moved: vec![u32::MAX; count],
        }
    }

    fn corner(&mut self, from: &Mesh, corner: Corner) -> u32 {
        let new = self.mesh.vertices.len() as u32;
        match corner {
            Corner::Old(i) => {
                let moved = &mut self.moved[i as usize];
                if *moved == u32::MAX {
                    *moved = new;
                    self.mesh.vertices.push(from.vertices[i as usize]);
                }
                *moved
            }
            Corner::New(vertex) => {
                self.mesh.vertices.push(vertex);
                new
            }
        }
    }

    fn triangle(&mut self, from: &Mesh, corners: [Corner; 3], group: u32) {
        let places = corners.map(|corner| corner.vertex(from).at);
        if places[0] == places[1] || places[1] == places[2] || places[2] == places[0] {
            return;
        }
        for corner in corners {
            let index = self.corner(from, corner);
            self.mesh.indices.push(index);
        }
        self.group_of.push(group);
    }
}

/// A corner of a cut triangle.
#[derive(Clone, Copy)]
enum Corner {
    Old(u32),
    New(Vertex),
}

impl Corner {
    fn vertex(self, mesh: &Mesh) -> Vertex {
        match self {
            Self::Old(i) => mesh.vertices[i as usize],
            Self::New(vertex) => vertex,
        }
    }
}

/// Triangles below and above a plane across an axis.
fn halves(
    mesh: &Mesh,
    group_of: &[u32],
    groups: &[[[i32; 3]; 2]],
    axis: usize,
    plane: i32,
    half: i32,
    axes: usize,
) -> [(Mesh, Vec<u32>); 2] {
    let mut sides = [(); 2].map(|()| Side::new(mesh.vertices.len()));
    for (triangle, &group) in mesh.triangles().iter().zip(group_of) {
        let old = triangle.map(Corner::Old);
        let mut group = group;
        if let Some([low, high]) = groups.get(group as usize) {
            if (0..axes).all(|k| high[k] - low[k] <= half) {
                let middle = (i64::from(low[axis]) + i64::from(high[axis])) / 2;
                sides[usize::from(middle >= i64::from(plane))].triangle(mesh, old, group);
                continue;
            }
            group = FREE;
        }
        let above = triangle.map(|i| mesh.vertices[i as usize].at[axis].cmp(&plane));
        if above.iter().all(|a| a.is_le()) {
            sides[0].triangle(mesh, old, group);
            continue;
        }
        if above.iter().all(|a| a.is_ge()) {
            sides[1].triangle(mesh, old, group);
            continue;
        }
        let mut outlines = [Vec::with_capacity(4), Vec::with_capacity(4)];
        for k in 0..3 {
            let next = (k + 1) % 3;
            if above[k].is_le() {
                outlines[0].push(old[k]);
            }
            if above[k].is_ge() {
                outlines[1].push(old[k]);
            }
            if (above[k].is_lt() && above[next].is_gt())
                || (above[k].is_gt() && above[next].is_lt())
            {
                let [a, b] = [k, next].map(|k| mesh.vertices[triangle[k] as usize]);
                let cut = Corner::New(cut(a, b, axis, plane));
                outlines[0].push(cut);
                outlines[1].push(cut);
            }
        }
        for (side, outline) in sides.iter_mut().zip(&outlines) {
            for pair in outline.windows(2).skip(1) {
                side.triangle(mesh, [outline[0], pair[0], pair[1]], group);
            }
        }
    }
    sides.map(|side| (side.mesh, side.group_of))
}

/// Where an edge meets a plane: the same whichever way round it is given.
fn cut(a: Vertex, b: Vertex, axis: usize, plane: i32) -> Vertex {
    let (a, b) = if a.at <= b.at { (a, b) } else { (b, a) };
    let along = |k: usize| f64::from(b.at[k]) - f64::from(a.at[k]);
    let t = (f64::from(plane) - f64::from(a.at[axis])) / along(axis);
    let mix = |x: f32, y: f32| (f64::from(x) + (f64::from(y) - f64::from(x)) * t) as f32 + 0.0;
    let mut at: [i32; 3] =
        std::array::from_fn(|k| (f64::from(a.at[k]) + along(k) * t).round() as i32);
    at[axis] = plane;
    let normal = Vec3::from_array(std::array::from_fn(|k| mix(a.normal[k], b.normal[k])));
    Vertex {
        at,
        normal: normal.normalize_or_zero().to_array().map(|x| x + 0.0),
        uv: std::array::from_fn(|k| mix(a.uv[k], b.uv[k])),
        color: std::array::from_fn(|k| {
            let (x, y) = (f64::from(a.color[k]), f64::from(b.color[k]));
            (x + (y - x) * t).round() as u16
        }),
        feature: a.feature,
        material: a.material,
    }
}
