//! Heat in the layers of a wall, column by column, and what leaves it.

use super::cooling::{Film, STEFAN_BOLTZMANN};
use super::material::{CHAR_ABSORPTIVITY, Material};
use super::skin::Skin;

/// Finest and coarsest cell through a layer [m].
const THROUGH_M: [f64; 2] = [0.25e-3, 0.6e-3];
/// Over this time heat spreads by about a cell through a layer [s].
const CELL_S: f64 = 0.5;
/// Most cells through a layer.
const MOST_CELLS: f64 = 8.0;
/// A column this close to the air's temperature, without light, is left alone [K].
const COLD_K: f64 = 0.05;
/// A level conducts along the wall once this share of a difference would flow to a neighbour [-].
const SPREADS: f64 = 0.02;
/// Conductivity of air in a gap [W/(m K)], near 350 K (Incropera, table A.4).
const GAP_WPMK: f64 = 0.03;
/// Exchange factor of the two faces of a gap, both of emissivity 0.9: 1/(1/0.9 + 1/0.9 - 1).
const GAP_EXCHANGE: f64 = 0.82;
/// Share of a cell's mass below which it counts as gone.
const LEAST_LEFT: f64 = 1e-3;

/// A slice of a wall: one cell of every column.
#[derive(Clone, Copy, Debug)]
struct Level {
    material: &'static Material,
    thickness_m: f64,
    /// Air between it and the level before [m].
    gap_m: f64,
    /// Conductance to the level before where both are whole, without a gap [W/(m² K)].
    joined_wpm2k: f64,
    /// Time for which it has not conducted along the wall [s].
    waits_s: f64,
}

impl Level {
    /// Resistance of half of what is left of it [m² K/W].
    fn half_m2kpw(&self, left: f64) -> f64 {
        0.5 * left * self.thickness_m / self.material.through_wpmk
    }

    /// Heat that warms a square metre by a kelvin [J/(m² K)].
    fn capacity_jpm2k(&self) -> f64 {
        self.material.capacity_jpm3k() * self.thickness_m
    }
}

/// Temperatures and masses in a square of a wall.
#[derive(Clone, Debug)]
pub struct HeatGrid {
    /// Columns along each side.
    pub side: usize,
    /// Distance between columns [m].
    pub cell_m: f64,
    levels: Vec<Level>,
    /// Absorptivity of the face when new.
    absorptivity: f64,
    /// The level that counts, and its limit [K].
    fails_at: (usize, f64),
    /// Cells of the first layer, and columns in which it is burnt through.
    first_cells: usize,
    open_columns: usize,
    /// Columns that there are.
    there: Vec<bool>,
    /// Temperatures [K], a column's cells one after the other from its face on.
    temperature_k: Vec<f64>,
    /// What is left of the cells' mass.
    left: Vec<f64>,
    /// Faces that have turned black.
    is_black: Vec<bool>,
    /// Energy that has fallen on a column since the last step [J/m²].
    dose_jpm2: Vec<f64>,
    /// Energy absorbed, lost to the air, and spent on what left, with its own heat, since the start [J].
    pub spent_j: [f64; 3],
    /// Columns that are warm or lit, and those beside them: the rest waits.
    active: Vec<bool>,
    /// Whether none is.
    is_idle: bool,
    /// Whether light has left a mark: a black face, or mass that is gone.
    is_marked: bool,
    /// The hottest place, and the hottest of what counts [K].
    peaks_k: [f64; 2],
    lateral_k: Vec<f64>,
}

impl HeatGrid {
    /// A wall at a temperature [K], whose face absorbs so much; `there` says which columns there are, row by row.
    pub fn new(
        skin: &Skin,
        absorptivity: f64,
        cell_m: f64,
        there: Vec<bool>,
        temperature_k: f64,
    ) -> Self {
        let side = there.len().isqrt();
        let mut levels = Vec::new();
        let mut fails_at = (0, skin.limit_k);
        for (at, layer) in skin.layers.iter().enumerate() {
            let material = layer.material;
            let [fine_m, coarse_m] = THROUGH_M;
            let wanted_m = (CELL_S * material.through_wpmk / material.capacity_jpm3k())
                .sqrt()
                .clamp(fine_m, coarse_m);
            let cells = (layer.thickness_m / wanted_m)
                .round()
                .clamp(1.0, MOST_CELLS);
            if at == skin.fails_at.0 {
                let depth = (skin.fails_at.1 * cells).min(cells - 1.0);
                fails_at.0 = levels.len() + depth as usize;
            }
            for cell in 0..cells as usize {
                let mut level = Level {
                    material,
                    thickness_m: layer.thickness_m / cells,
                    gap_m: if cell == 0 { layer.gap_m } else { 0.0 },
                    joined_wpm2k: 0.0,
                    waits_s: 0.0,
                };
                let before = levels
                    .last()
                    .map_or(0.0, |before: &Level| before.half_m2kpw(1.0));
                level.joined_wpm2k = 1.0 / (before + level.half_m2kpw(1.0));
                levels.push(level);
            }
        }
        let cells = there.len() * levels.len();
        let deeper = levels.iter().skip(1).position(|level: &Level| {
            level.gap_m > 0.0
                || skin.layers.first().map(|layer| layer.material) != Some(level.material)
        });
        Self {
            first_cells: deeper.map_or(levels.len(), |at| at + 1),
            open_columns: 0,
            side,
            cell_m,
            absorptivity,
            fails_at,
            temperature_k: vec![temperature_k; cells],
            left: vec![1.0; cells],
            is_black: vec![false; there.len()],
            dose_jpm2: vec![0.0; there.len()],
            spent_j: [0.0; 3],
            active: vec![false; there.len()],
            is_idle: false,
            is_marked: false,
            peaks_k: [temperature_k; 2],
            lateral_k: vec![0.0; there.len()],
            levels,
            there,
        }
    }

    /// Energy that falls on the columns until the next step [J/m²], row by row, to add to.
    pub fn dose_jpm2(&mut self) -> &mut [f64] {
        self.is_idle = false;
        &mut self.dose_jpm2
    }

    /// Whether a column is there.
    pub fn is_there(&self, column: usize) -> bool {
        self.there[column]
    }

    /// The first cell that is left of a column.
    fn top(&self, column: usize) -> Option<usize> {
        let deep = self.levels.len();
        (0..deep).find(|level| self.left[column * deep + level] > 0.0)
    }

    /// Whether the face of a column has turned black.
    pub fn is_black(&self, column: usize) -> bool {
        self.is_black[column]
    }

    /// Whether a column's first layer is burnt through.
    pub fn is_open(&self, column: usize) -> bool {
        let inmost = column * self.levels.len() + self.first_cells - 1;
        self.there[column] && self.left[inmost] == 0.0
    }

    /// Temperature of the face of a column [K]; `None` where nothing is left.
    pub fn face_k(&self, column: usize) -> Option<f64> {
        let top = self.top(column).filter(|_| self.there[column])?;
        Some(self.temperature_k[column * self.levels.len() + top])
    }

    /// The hottest place after the last step [K].
    pub fn hottest_k(&self) -> f64 {
        self.peaks_k[0]
    }

    /// The hottest place of what counts after the last step [K].
    pub fn critical_k(&self) -> f64 {
        self.peaks_k[1]
    }

    /// Area whose first layer is burnt through [m²].
    pub fn hole_m2(&self) -> f64 {
        self.open_columns as f64 * self.cell_m.powi(2)
    }

    /// Area over which what counts has reached its limit [m²].
    pub fn failed_m2(&self) -> f64 {
        let (level, limit_k) = self.fails_at;
        let deep = self.levels.len();
        let failed = |column: &usize| {
            let at = column * deep + level;
            self.there[*column] && (self.left[at] == 0.0 || self.temperature_k[at] >= limit_k)
        };
        (0..self.there.len()).filter(failed).count() as f64 * self.cell_m.powi(2)
    }

    /// Whether light has left a mark: a black face, or mass that is gone.
    pub fn is_marked(&self) -> bool {
        self.is_marked
    }

    /// Goes on by a time [s] under the doses since the last step, in the air of a film.
    ///
    /// Along the wall explicit, in as many steps as stability asks for; through it backward Euler, cooling included;
    /// then what is beyond its temperature of ablation spends the excess on mass.
    pub fn step(&mut self, dt_s: f64, film: &Film) {
        if self.is_idle {
            return;
        }
        let hottest_k = (0..self.there.len())
            .filter_map(|column| self.face_k(column))
            .fold(film.air_k, f64::max);
        self.advance(dt_s, film.air_k, film.convection_wpm2k(hottest_k));
    }

    /// Goes on by a time [s] in air of a temperature [K] with a coefficient of convection [W/(m² K)].
    pub fn advance(&mut self, dt_s: f64, air_k: f64, convection_wpm2k: f64) {
        self.activate(air_k);
        self.spread(dt_s);
        self.peaks_k = [air_k; 2];
        let mut column_of = Column::new(self.levels.len());
        for column in 0..self.there.len() {
            if self.active[column] {
                self.step_column(column, dt_s, (air_k, convection_wpm2k), &mut column_of);
                self.find_peaks(column);
            }
            self.dose_jpm2[column] = 0.0;
        }
    }

    /// Takes a column into the peaks.
    fn find_peaks(&mut self, column: usize) {
        let deep = self.levels.len();
        let critical = self.fails_at.0;
        for level in 0..deep {
            let at = column * deep + level;
            if self.left[at] > 0.0 {
                self.peaks_k[0] = self.peaks_k[0].max(self.temperature_k[at]);
            }
            if level == critical {
                self.peaks_k[1] = self.peaks_k[1].max(self.temperature_k[at]);
            }
        }
    }

    /// Finds the columns that are warm or lit, and those beside them.
    fn activate(&mut self, air_k: f64) {
        let (deep, side) = (self.levels.len(), self.side);
        self.active.fill(false);
        self.is_idle = true;
        for column in 0..self.there.len() {
            let cells = column * deep..(column + 1) * deep;
            let is_cold = self.dose_jpm2[column] == 0.0
                && (self.temperature_k[cells].iter()).all(|t_k| (t_k - air_k).abs() < COLD_K);
            if !self.there[column] || is_cold {
                continue;
            }
            self.is_idle = false;
            let (x, y) = (column % side, column / side);
            self.active[column] = true;
            if x > 0 {
                self.active[column - 1] = self.there[column - 1];
            }
            if x + 1 < side {
                self.active[column + 1] = self.there[column + 1];
            }
            if y > 0 {
                self.active[column - side] = self.there[column - side];
            }
            if y + 1 < side {
                self.active[column + side] = self.there[column + side];
            }
        }
    }

    /// Conducts along the wall.
    fn spread(&mut self, dt_s: f64) {
        let (deep, side) = (self.levels.len(), self.side);
        for level in 0..deep {
            let material = self.levels[level].material;
            let rate_per_s =
                material.along_wpmk / (material.capacity_jpm3k() * self.cell_m.powi(2));
            let waited_s = self.levels[level].waits_s + dt_s;
            if rate_per_s * waited_s < SPREADS {
                self.levels[level].waits_s = waited_s;
                continue;
            }
            self.levels[level].waits_s = 0.0;
            // Four neighbours: stable up to a quarter.
            let steps = (5.0 * rate_per_s * waited_s).ceil().max(1.0);
            let share = rate_per_s * waited_s / steps;
            for _ in 0..steps as usize {
                for column in 0..self.there.len() {
                    let at = |column: usize| column * deep + level;
                    let own_left = self.left[at(column)];
                    if !self.active[column] || own_left == 0.0 {
                        self.lateral_k[column] = 0.0;
                        continue;
                    }
                    let (x, y) = (column % side, column / side);
                    let own_k = self.temperature_k[at(column)];
                    let flow = |is_inside: bool, other: usize| {
                        if !is_inside || !self.active[other] {
                            return 0.0;
                        }
                        // Heat passes through what both have left.
                        let left = own_left.min(self.left[at(other)]);
                        left * (self.temperature_k[at(other)] - own_k)
                    };
                    let sum = flow(x > 0, column.wrapping_sub(1))
                        + flow(x + 1 < side, column + 1)
                        + flow(y > 0, column.wrapping_sub(side))
                        + flow(y + 1 < side, column + side);
                    self.lateral_k[column] = share * sum / own_left;
                }
                for (column, change_k) in self.lateral_k.iter().enumerate() {
                    self.temperature_k[column * deep + level] += change_k;
                }
            }
        }
    }

    /// Absorptivity of the face in the middle; of what is not there, all.
    pub fn middle_absorptivity(&self) -> f64 {
        let middle = self.there.len() / 2 + self.side / 2;
        let top = self.top(middle).filter(|_| self.there[middle]);
        top.map_or(1.0, |top| self.absorptivity(middle, top))
    }

    /// Absorptivity of a column's face whose first cell is this one.
    fn absorptivity(&self, column: usize, top: usize) -> f64 {
        let material = self.levels[top].material;
        let own = match (self.is_black[column], top) {
            (true, _) if material.chars => return CHAR_ABSORPTIVITY,
            (_, 0) => self.absorptivity,
            // What lies bare below the face has its own.
            _ if self.levels[0].material == material => self.absorptivity,
            _ => material.absorptivity,
        };
        let face_k = self.temperature_k[column * self.levels.len() + top];
        (own + material.absorptivity_per_k * (face_k - 300.0)).clamp(0.0, 1.0)
    }

    /// Conducts through a column, cools its face and takes away what ablates.
    fn step_column(
        &mut self,
        column: usize,
        dt_s: f64,
        (air_k, convection_wpm2k): (f64, f64),
        solver: &mut Column,
    ) {
        let Some(top) = self.top(column) else {
            return;
        };
        let deep = self.levels.len();
        let first = column * deep;
        let area_m2 = self.cell_m.powi(2);
        let absorbed_jpm2 = self.absorptivity(column, top) * self.dose_jpm2[column];
        let face_k = self.temperature_k[first + top];
        let radiation = self.levels[top].material.emissivity * STEFAN_BOLTZMANN;
        let loss_wpm2 =
            convection_wpm2k * (face_k - air_k) + radiation * (face_k.powi(4) - air_k.powi(4));
        let slope_wpm2k = convection_wpm2k + 4.0 * radiation * face_k.powi(3);
        solver.clear();
        for level in top..deep {
            let own = &self.levels[level];
            let left = self.left[first + level];
            let capacity = left * own.capacity_jpm2k();
            let t_k = self.temperature_k[first + level];
            solver.push(capacity, t_k);
            if level > top {
                let before_left = self.left[first + level - 1];
                if own.gap_m == 0.0 && before_left == 1.0 {
                    solver.join(dt_s * own.joined_wpm2k);
                    continue;
                }
                let before = &self.levels[level - 1];
                let mut resistance = before.half_m2kpw(before_left) + own.half_m2kpw(left);
                if own.gap_m > 0.0 {
                    let mean_k = 0.5 * (t_k + self.temperature_k[first + level - 1]);
                    let radiates = 4.0 * GAP_EXCHANGE * STEFAN_BOLTZMANN * mean_k.powi(3);
                    resistance += 1.0 / (GAP_WPMK / own.gap_m + radiates);
                }
                solver.join(dt_s / resistance);
            }
        }
        solver.face(absorbed_jpm2, dt_s * loss_wpm2, dt_s * slope_wpm2k);
        let rise_k = solver.solve();
        let lost_jpm2 = dt_s * (loss_wpm2 + slope_wpm2k * rise_k[0]);
        for (level, rise_k) in (top..deep).zip(rise_k) {
            self.temperature_k[first + level] += rise_k;
        }
        let gone_jpm2 = self.ablate(column, top);
        for (spent_j, each_jpm2) in
            (self.spent_j.iter_mut()).zip([absorbed_jpm2, lost_jpm2, gone_jpm2])
        {
            *spent_j += area_m2 * each_jpm2;
        }
    }

    /// Takes away what the excess over the temperature of ablation can; what it cost, with the heat that left [J/m²].
    fn ablate(&mut self, column: usize, top: usize) -> f64 {
        let deep = self.levels.len();
        let mut gone_jpm2 = 0.0;
        let mut handed_jpm2 = 0.0;
        for level in top..deep {
            let at = column * deep + level;
            let Level {
                material,
                thickness_m,
                ..
            } = self.levels[level];
            let whole_kgpm2 = material.density_kgpm3 * thickness_m;
            let capacity = self.left[at] * whole_kgpm2 * material.specific_heat_jpkgk;
            self.temperature_k[at] += handed_jpm2 / capacity;
            let excess_k = self.temperature_k[at] - material.ablates_k;
            if excess_k <= 0.0 {
                break;
            }
            self.is_marked = true;
            self.is_black[column] |= material.chars;
            let excess_jpm2 = capacity * excess_k;
            let mass_kgpm2 = self.left[at] * whole_kgpm2;
            let taken_kgpm2 = (excess_jpm2 / material.ablation_jpkg).min(mass_kgpm2);
            let left = (mass_kgpm2 - taken_kgpm2) / whole_kgpm2;
            let heat_jpkg = material.specific_heat_jpkgk * material.ablates_k;
            if left > LEAST_LEFT {
                self.left[at] = left;
                self.temperature_k[at] = material.ablates_k;
                gone_jpm2 += taken_kgpm2 * (material.ablation_jpkg + heat_jpkg);
                break;
            }
            self.left[at] = 0.0;
            self.open_columns += usize::from(level + 1 == self.first_cells);
            handed_jpm2 = (excess_jpm2 - mass_kgpm2 * material.ablation_jpkg).max(0.0);
            gone_jpm2 += excess_jpm2 - handed_jpm2 + mass_kgpm2 * heat_jpkg;
            if level + 1 == deep {
                gone_jpm2 += handed_jpm2;
            }
        }
        gone_jpm2
    }

    /// Heat in it, from 0 K on [J].
    #[cfg(test)]
    pub(super) fn heat_j(&self) -> f64 {
        let deep = self.levels.len();
        let cells = (0..self.temperature_k.len()).filter(|at| self.there[at / deep]);
        let heat = |at: usize| {
            self.left[at] * self.levels[at % deep].capacity_jpm2k() * self.temperature_k[at]
        };
        cells.map(heat).sum::<f64>() * self.cell_m.powi(2)
    }
}

/// A tridiagonal system: rises of a column's cells in a step.
struct Column {
    capacity: Vec<f64>,
    before_k: Vec<f64>,
    /// Conductance times the step between a cell and the next [J/(m² K)].
    joined: Vec<f64>,
    diagonal: Vec<f64>,
    rise_k: Vec<f64>,
    face: (f64, f64),
}

impl Column {
    fn new(deep: usize) -> Self {
        let room = || Vec::with_capacity(deep);
        Self {
            capacity: room(),
            before_k: room(),
            joined: room(),
            diagonal: room(),
            rise_k: room(),
            face: (0.0, 0.0),
        }
    }

    fn clear(&mut self) {
        self.capacity.clear();
        self.before_k.clear();
        self.joined.clear();
    }

    fn push(&mut self, capacity: f64, t_k: f64) {
        self.capacity.push(capacity);
        self.before_k.push(t_k);
    }

    fn join(&mut self, conducts: f64) {
        self.joined.push(conducts);
    }

    /// What the face absorbs and loses [J/m²], and how the loss grows [J/(m² K)].
    fn face(&mut self, absorbed: f64, loss: f64, slope: f64) {
        self.face = (absorbed - loss, slope);
    }

    /// Thomas's algorithm.
    fn solve(&mut self) -> &[f64] {
        let n = self.capacity.len();
        self.diagonal.clear();
        self.rise_k.clear();
        for i in 0..n {
            let (up, down) = (
                i.checked_sub(1).map_or(0.0, |i| self.joined[i]),
                self.joined.get(i).copied().unwrap_or(0.0),
            );
            let t_k = self.before_k[i];
            let mut own = self.capacity[i] + up + down;
            let mut heat = 0.0;
            if i > 0 {
                heat += up * (self.before_k[i - 1] - t_k);
            }
            if i + 1 < n {
                heat += down * (self.before_k[i + 1] - t_k);
            }
            if i == 0 {
                own += self.face.1;
                heat += self.face.0;
            } else {
                let factor = up / self.diagonal[i - 1];
                own -= factor * up;
                heat += factor * self.rise_k[i - 1];
            }
            self.diagonal.push(own);
            self.rise_k.push(heat);
        }
        for i in (0..n).rev() {
            let below = match i + 1 < n {
                true => self.joined[i] * self.rise_k[i + 1],
                false => 0.0,
            };
            self.rise_k[i] = (self.rise_k[i] + below) / self.diagonal[i];
        }
        &self.rise_k
    }
}
