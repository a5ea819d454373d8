//! Where a local model stands on the Earth (paper, eq. 3): three translations, three rotations and a scale, fitted to ground
//! control points.
//!
//! X = T + (1 + λ)·R·(x − x₀): the Helmert or Bursa–Wolf transformation, with the full rotation (that of a local model is large)
//! and about the centre x₀ of the points, which keeps translation, rotation and scale apart. The closed form (Umeyama,
//! "Least-squares estimation of transformation parameters between two point patterns", 1991) starts
//! Levenberg–Marquardt, which takes each point's accuracy along and across the ground.

use crate::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn, Matrix3, Vector3};

mod suspects;
pub use suspects::{Suspect, suspects};

/// A point that is known in the model and on the Earth.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlPoint {
    /// What it is called.
    pub name: String,
    /// In the model's own frame, in the model's unit.
    pub r_local: DVec3,
    /// On the Earth [m].
    pub r_ecef_m: DVec3,
    /// How exactly it is known along the ground and in height, one sigma [m].
    pub sigma_m: [f64; 2],
}

/// What is free in the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Three translations, three rotations, scale.
    Seven,
    /// Three translations and three rotations: the model's unit is the metre.
    FixedScale,
    /// Three translations, one angle about the vertical, scale: eq. 3 as the paper prints it. The model's z axis must be
    /// vertical.
    Paper,
}

impl Mode {
    /// Number of free parameters.
    pub fn free(self) -> usize {
        match self {
            Self::Seven => 7,
            Self::FixedScale => 6,
            Self::Paper => 5,
        }
    }

    /// Fewest points that determine them.
    fn fewest(self) -> usize {
        if self == Self::Paper { 2 } else { 3 }
    }

    /// Names and units of the free parameters, in the order of the covariance.
    pub fn names(self) -> Vec<&'static str> {
        let all = [
            "east_m",
            "north_m",
            "up_m",
            "about_east_rad",
            "about_north_rad",
            "about_up_rad",
            "scale",
        ];
        let free = |name: &&str| match self {
            Self::Seven => true,
            Self::FixedScale => *name != "scale",
            Self::Paper => !["about_east_rad", "about_north_rad"].contains(name),
        };
        all.into_iter().filter(free).collect()
    }
}

/// Where a local model stands: X = `r_ecef_m` + `scale` · R · (x − `center_local`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// A point of the model, the centre of the control points, in its own frame and unit.
    pub center_local: DVec3,
    /// Where that point stands [m].
    pub r_ecef_m: DVec3,
    /// Turns the model's axes into ECEF's.
    pub q_ecef_local: DQuat,
    /// Metres in the model's unit.
    pub scale: f64,
}

impl Placement {
    /// From the model's frame to ECEF [m].
    pub fn affine(&self) -> DAffine3 {
        let matrix = DMat3::from_quat(self.q_ecef_local) * self.scale;
        DAffine3::from_mat3_translation(matrix, self.r_ecef_m - matrix * self.center_local)
    }

    /// A point of the model in ECEF [m].
    pub fn to_ecef(&self, r_local: DVec3) -> DVec3 {
        self.r_ecef_m + self.scale * (self.q_ecef_local * (r_local - self.center_local))
    }
}

/// A fitted placement and how good it is.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Where the model stands.
    pub placement: Placement,
    /// What was free.
    pub mode: Mode,
    /// The frame of residuals and covariance: east, north, up at the centre of the points.
    pub site: SiteFrame,
    /// Surveyed place less fitted place of each point, east, north, up [m].
    pub residuals_enu_m: Vec<DVec3>,
    /// Root of the mean squared distance of surveyed and fitted places [m].
    pub rms_m: f64,
    /// Three a point, less the free parameters.
    pub degrees_of_freedom: usize,
    /// Residuals over their stated accuracy, 1 where that is right; `None` without a degree of freedom.
    pub sigma0: Option<f64>,
    /// Covariance of the free parameters (`Mode::names`) that follows from the stated accuracies: the place of the centre, small turns
    /// about east, north and up, and the scale. Times `sigma0`² it is that of the residuals.
    pub covariance: DMatrix<f64>,
    /// Spread of the points across their longest direction, of that along it (0: on one line).
    pub spread: f64,
    /// How far the closed form puts a point from the fit, at most [m]; 0 but for rounding where all accuracies are one.
    pub closed_form_m: f64,
    /// What a reader should know about the result.
    pub warnings: Vec<String>,
}

/// Why points give no placement.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeoreferenceError {
    /// Too few points.
    #[error("{found} control points do not determine {free} parameters; give {fewest} or more")]
    TooFew {
        /// Points that there are.
        found: usize,
        /// Parameters that are free.
        free: usize,
        /// Points that are needed.
        fewest: usize,
    },
    /// Points at one place.
    #[error("all control points lie at one place {0}; survey points that lie apart")]
    Coincident(&'static str),
    /// Points on a line.
    #[error(
        "all control points lie on one line {0}, about which the model could turn; survey one beside it"
    )]
    Collinear(&'static str),
    /// Two points in one place of the model.
    #[error(
        "control points {0} and {1} have the same place {2} but not on the other side; mend or remove one"
    )]
    Twice(String, String, &'static str),
    /// Something that is no number.
    #[error(
        "control point {0}: a coordinate or accuracy is no finite positive number; mend the line"
    )]
    NotFinite(String),
    /// The iteration did not come to an end.
    #[error("the fit does not converge ({0}); check the control points' coordinates and system")]
    NoConvergence(String),
}

/// Vectors of both libraries.
fn na(v: DVec3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// The points as the fit sees them: about their centres, ENU on the Earth's side.
struct Pairs {
    local: Vec<DVec3>,
    enu_m: Vec<DVec3>,
    sigma_m: Vec<DVec3>,
}

/// A similarity between centred local coordinates and ENU.
#[derive(Clone, Copy)]
struct Similarity {
    shift_m: DVec3,
    q: DQuat,
    scale: f64,
}

impl Similarity {
    fn apply(&self, r: DVec3) -> DVec3 {
        self.shift_m + self.scale * (self.q * r)
    }
}

impl Pairs {
    /// One weight a point [1/m²], for the closed form.
    fn weight(&self, i: usize) -> f64 {
        3.0 / self.sigma_m[i].length_squared()
    }

    /// Umeyama's closed form over the points `of`; `None` where they do not determine it.
    fn closed_form(&self, mode: Mode, of: &[usize]) -> Option<Similarity> {
        let total: f64 = of.iter().map(|&i| self.weight(i)).sum();
        let mean =
            |all: &[DVec3]| of.iter().map(|&i| all[i] * self.weight(i)).sum::<DVec3>() / total;
        let (center, center_m) = (mean(&self.local), mean(&self.enu_m));
        let mut cross = Matrix3::zeros();
        let (mut spread, mut spread_m) = (0.0, 0.0);
        for &i in of {
            let (a, b) = (self.local[i] - center, self.enu_m[i] - center_m);
            cross += na(b) * na(a).transpose() * self.weight(i);
            spread += a.length_squared() * self.weight(i);
            spread_m += b.length_squared() * self.weight(i);
        }
        let size = (spread * spread_m).sqrt();
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        let (q, gain) = if mode == Mode::Paper {
            let (sin, cos) = (cross[(1, 0)] - cross[(0, 1)], cross[(0, 0)] + cross[(1, 1)]);
            if sin.hypot(cos) < 1e-12 * size {
                return None;
            }
            (
                DQuat::from_rotation_z(sin.atan2(cos)),
                sin.hypot(cos) + cross[(2, 2)],
            )
        } else {
            let svd = cross.svd(true, true);
            let (u, v_t) = (svd.u?, svd.v_t?);
            // The second largest tells a line from a plane.
            if svd.singular_values[1] < 1e-14 * size {
                return None;
            }
            let sign = (u.determinant() * v_t.determinant()).signum();
            let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
            let rotation = u * flip * v_t;
            let columns = std::array::from_fn::<DVec3, 3, _>(|k| {
                DVec3::new(rotation[(0, k)], rotation[(1, k)], rotation[(2, k)])
            });
            let gain = svd.singular_values.dot(&flip.diagonal());
            let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
            (DQuat::from_mat3(&matrix).normalize(), gain)
        };
        let scale = if mode == Mode::FixedScale {
            1.0
        } else {
            gain / spread
        };
        (scale > 0.0).then(|| Similarity {
            shift_m: center_m - scale * (q * center),
            q,
            scale,
        })
    }

    /// Sum of squared residuals over their accuracies.
    fn misfit(&self, similarity: &Similarity, of: &[usize]) -> f64 {
        let one = |&i: &usize| {
            ((self.enu_m[i] - similarity.apply(self.local[i])) / self.sigma_m[i]).length_squared()
        };
        of.iter().map(one).sum()
    }

    /// Second largest over largest spread of the points.
    fn spread(points: &[DVec3]) -> [f64; 2] {
        let mean = points.iter().sum::<DVec3>() / points.len() as f64;
        let outer = |r: &DVec3| na(*r - mean) * na(*r - mean).transpose();
        let sum: Matrix3<f64> = points.iter().map(outer).sum();
        let mut sizes: Vec<f64> = sum
            .symmetric_eigenvalues()
            .iter()
            .map(|v| v.max(0.0).sqrt())
            .collect();
        sizes.sort_by(f64::total_cmp);
        [sizes[2], sizes[1] / sizes[2].max(f64::MIN_POSITIVE)]
    }
}

/// The least-squares problem about a similarity: small shift, turn and change of scale.
struct Problem<'a> {
    pairs: &'a Pairs,
    about: Similarity,
    mode: Mode,
    x: DVector<f64>,
}

impl Problem<'_> {
    /// Shift, turn and scale that the free parameters mean.
    fn similarity(&self) -> (Similarity, DVec3) {
        let x = &self.x;
        let turn = match self.mode {
            Mode::Paper => DVec3::new(0.0, 0.0, x[3]),
            _ => DVec3::new(x[3], x[4], x[5]),
        };
        let scale = match self.mode {
            Mode::Seven => x[6],
            Mode::FixedScale => 0.0,
            Mode::Paper => x[4],
        };
        let found = Similarity {
            shift_m: self.about.shift_m + DVec3::new(x[0], x[1], x[2]),
            q: DQuat::from_scaled_axis(turn) * self.about.q,
            scale: self.about.scale * (1.0 + scale),
        };
        (found, turn)
    }
}

/// d(exp(a)·v) = −[exp(a)·v]× · J·da: the left Jacobian of the rotation group.
fn left_jacobian(a: DVec3) -> Matrix3<f64> {
    let cross = na(a).cross_matrix();
    let angle = a.length();
    let (first, second) = if angle < 1e-4 {
        (0.5, 1.0 / 6.0)
    } else {
        let (sin, cos) = angle.sin_cos();
        ((1.0 - cos) / angle.powi(2), (angle - sin) / angle.powi(3))
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.x.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.x.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let (similarity, _) = self.similarity();
        let pairs = self.pairs;
        let all = (0..pairs.local.len()).flat_map(|i| {
            let gap_m = pairs.enu_m[i] - similarity.apply(pairs.local[i]);
            (gap_m / pairs.sigma_m[i]).to_array()
        });
        Some(DVector::from_iterator(3 * pairs.local.len(), all))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let (similarity, turn) = self.similarity();
        let left = left_jacobian(turn);
        let mut jacobian = DMatrix::zeros(3 * self.pairs.local.len(), self.mode.free());
        for (i, r_local) in self.pairs.local.iter().enumerate() {
            let arm = similarity.scale * (similarity.q * *r_local);
            let turned = na(arm).cross_matrix() * left;
            let stretched = -na(arm) / (similarity.scale / self.about.scale);
            for axis in 0..3 {
                let row = 3 * i + axis;
                let weight = 1.0 / self.pairs.sigma_m[i][axis];
                jacobian[(row, axis)] = -weight;
                let mut put = |column: usize, value: f64| jacobian[(row, column)] = weight * value;
                match self.mode {
                    Mode::Paper => {
                        put(3, turned[(axis, 2)]);
                        put(4, stretched[axis]);
                    }
                    _ => (0..3).for_each(|k| put(3 + k, turned[(axis, k)])),
                }
                if self.mode == Mode::Seven {
                    put(6, stretched[axis]);
                }
            }
        }
        Some(jacobian)
    }
}

/// Checks the points, and centres them.
fn prepare(
    points: &[ControlPoint],
    mode: Mode,
) -> Result<(Pairs, DVec3, SiteFrame), GeoreferenceError> {
    let (found, free, fewest) = (points.len(), mode.free(), mode.fewest());
    if found < fewest {
        return Err(GeoreferenceError::TooFew {
            found,
            free,
            fewest,
        });
    }
    for point in points {
        let sigmas = point.sigma_m.iter().all(|s| s.is_finite() && *s > 0.0);
        if !(point.r_local.is_finite() && point.r_ecef_m.is_finite() && sigmas) {
            return Err(GeoreferenceError::NotFinite(point.name.clone()));
        }
    }
    let center_local = points.iter().map(|p| p.r_local).sum::<DVec3>() / found as f64;
    let center_m = points.iter().map(|p| p.r_ecef_m).sum::<DVec3>() / found as f64;
    let site = SiteFrame::new(Geodetic::from_ecef(center_m));
    let pairs = Pairs {
        local: points.iter().map(|p| p.r_local - center_local).collect(),
        enu_m: points
            .iter()
            .map(|p| site.ecef_to_enu(p.r_ecef_m))
            .collect(),
        sigma_m: (points.iter())
            .map(|p| DVec3::new(p.sigma_m[0], p.sigma_m[0], p.sigma_m[1]))
            .collect(),
    };
    for (side, all) in [
        ("of the model", &pairs.local),
        ("on the Earth", &pairs.enu_m),
    ] {
        let [size, ratio] = Pairs::spread(all);
        let least = 1e-9 * all.iter().map(|r| r.length()).fold(1e-3, f64::max);
        if size < least {
            return Err(GeoreferenceError::Coincident(side));
        }
        if mode != Mode::Paper && ratio < 1e-6 {
            return Err(GeoreferenceError::Collinear(side));
        }
    }
    let near = |a: DVec3, b: DVec3, all: &[DVec3]| a.distance(b) < 1e-6 * Pairs::spread(all)[0];
    for i in 0..found {
        for j in 0..i {
            let local = near(pairs.local[i], pairs.local[j], &pairs.local);
            let earth = near(pairs.enu_m[i], pairs.enu_m[j], &pairs.enu_m);
            if local != earth {
                let side = if local {
                    "in the model"
                } else {
                    "on the Earth"
                };
                let name = |k: usize| points[k].name.clone();
                return Err(GeoreferenceError::Twice(name(j), name(i), side));
            }
        }
    }
    Ok((pairs, center_local, site))
}

/// Fits the placement of a model to control points.
///
/// Fails where the points are too few, lie in one place or on one line, or are no numbers.
pub fn fit(points: &[ControlPoint], mode: Mode) -> Result<Fit, GeoreferenceError> {
    let (pairs, center_local, site) = prepare(points, mode)?;
    let all: Vec<usize> = (0..points.len()).collect();
    let start = pairs.closed_form(mode, &all);
    let start = start.ok_or(GeoreferenceError::Collinear("of the model"))?;
    let problem = |about| Problem {
        pairs: &pairs,
        about,
        mode,
        x: DVector::zeros(mode.free()),
    };
    // To the last digits: residuals over accuracies are of the order of 1.
    let solver = LevenbergMarquardt::new().with_tol(1e-15).with_patience(200);
    let (solved, report) = solver.minimize(problem(start));
    let (mut found, _) = solved.similarity();
    found.q = found.q.normalize();
    let misfit = pairs.misfit(&found, &all);
    let from = pairs.misfit(&start, &all);
    // The closed form is the solution where all accuracies are one: nothing is left to gain, whatever the report says.
    if !report.termination.was_successful() && misfit > from * (1.0 + 1e-9) + 1e-12 {
        return Err(GeoreferenceError::NoConvergence(format!(
            "{:?}",
            report.termination
        )));
    }
    let jacobian = problem(found).jacobian().unwrap_or_default();
    let mut normal = jacobian.transpose() * &jacobian;
    // Parameters of one size before the inversion.
    let size: Vec<f64> = normal.diagonal().iter().map(|v| v.sqrt()).collect();
    for (i, a) in size.iter().enumerate() {
        for (j, b) in size.iter().enumerate() {
            normal[(i, j)] /= a * b;
        }
    }
    let side = "on the Earth";
    let mut covariance = normal
        .try_inverse()
        .ok_or(GeoreferenceError::Collinear(side))?;
    for (i, a) in size.iter().enumerate() {
        for (j, b) in size.iter().enumerate() {
            covariance[(i, j)] /= a * b;
        }
    }
    let placement = Placement {
        center_local,
        r_ecef_m: site.enu_to_ecef(found.shift_m),
        q_ecef_local: site.q_ecef_enu() * found.q,
        scale: found.scale,
    };
    let gap_m = |i: usize| pairs.enu_m[i] - found.apply(pairs.local[i]);
    let residuals_enu_m: Vec<DVec3> = all.iter().map(|&i| gap_m(i)).collect();
    let sum_m2: f64 = residuals_enu_m.iter().map(|r| r.length_squared()).sum();
    let degrees_of_freedom = (3 * points.len()).saturating_sub(mode.free());
    let sigma0 = (degrees_of_freedom > 0).then(|| (misfit / degrees_of_freedom as f64).sqrt());
    let apart = |i: &usize| {
        found
            .apply(pairs.local[*i])
            .distance(start.apply(pairs.local[*i]))
    };
    let [_, spread] = Pairs::spread(&pairs.enu_m);
    let mut warnings = Vec::new();
    if spread < 0.05 && mode != Mode::Paper {
        let turn = covariance.diagonal().rows(3, 3).max().sqrt();
        let mrad = 1e3 * turn * sigma0.unwrap_or(1.0);
        warnings.push(format!(
            "the points lie almost on a line (spread across it {:.1} % of that along it): the turn about it is known to {mrad:.2} mrad only; survey points beside it",
            100.0 * spread
        ));
    }
    if degrees_of_freedom < 3 {
        warnings.push("no point checks the others: a wrong one would not show; survey more".into());
    }
    if points.len() > 3 && mode != Mode::Paper && mirrored(&pairs, &all, mode, misfit) {
        warnings.push("the mirrored model fits far better: two of its columns are exchanged, or one has the wrong sign".into());
    }
    Ok(Fit {
        placement,
        mode,
        site,
        rms_m: (sum_m2 / points.len() as f64).sqrt(),
        residuals_enu_m,
        degrees_of_freedom,
        sigma0,
        covariance,
        spread,
        closed_form_m: all.iter().map(apart).fold(0.0, f64::max),
        warnings,
    })
}

/// Whether the model's mirror image fits far better.
fn mirrored(pairs: &Pairs, all: &[usize], mode: Mode, misfit: f64) -> bool {
    let mirror = Pairs {
        local: pairs
            .local
            .iter()
            .map(|r| DVec3::new(-r.x, r.y, r.z))
            .collect(),
        enu_m: pairs.enu_m.clone(),
        sigma_m: pairs.sigma_m.clone(),
    };
    let other = mirror
        .closed_form(mode, all)
        .map(|found| mirror.misfit(&found, all));
    other.is_some_and(|other| other < 0.01 * misfit)
}

#[cfg(test)]
mod tests;
