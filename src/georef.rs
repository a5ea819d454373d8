//! `boresight georef`: where a local model stands on the Earth, from ground control points.

use crate::models::ground::georeference::{
    ControlPoint, Fit, GeoreferenceError, Mode, Suspect, fit, suspects,
};
use crate::output::{self, OutputError};
use crate::projection::{Crs, CrsError, HEIGHTS_M, Heights, RADII_M};
use crate::sources::place::{Parameters, note_heights};
use crate::warning::{self, Notes, StrictError, Warning};
use clap::Args;
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What `boresight georef` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Ground control points: a CSV file with headings. The model's own coordinates stand under x, y, z; those on the Earth
    /// under east, north, height, or longitude, latitude, height, or ecef_x, ecef_y, ecef_z; name, sigma, sigma_ground and
    /// sigma_height (one sigma in metres) may stand beside them.
    pub points: PathBuf,
    /// The coordinate reference system of the places on the Earth: EPSG:7415, EPSG:2056+5728, EPSG:25832+ellipsoid, a PROJ string.
    /// Longitudes and latitudes are WGS 84's over its ellipsoid where nothing is said.
    #[arg(long)]
    pub crs: Option<String>,
    /// Height of the geoid over the ellipsoid, in place of EGM96's.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub geoid_height: Option<f64>,
    /// The model's unit is the metre: six parameters.
    #[arg(long, conflicts_with = "paper")]
    pub fixed_scale: bool,
    /// One angle about the vertical, scale and three translations, as eq. 3 of the paper is printed.
    #[arg(long)]
    pub paper: bool,
    /// Leave out points that do not belong with the others.
    #[arg(long)]
    pub robust: bool,
    /// File for the parameters, which `--georef` of `tiles build` and a scenario's sources take.
    #[arg(long, value_name = "PARAMS.toml")]
    pub out: Option<PathBuf>,
}

/// Why a model cannot be placed.
#[derive(Debug, thiserror::Error)]
pub enum GeorefError {
    /// The file of the points.
    #[error("{}: {source}; name a CSV file of control points", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: std::io::Error,
    },
    /// A line of it.
    #[error("{}:{line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What is wrong there and what mends it.
        what: String,
    },
    /// The coordinate system.
    #[error(transparent)]
    Crs(#[from] CrsError),
    /// A fit that means nothing.
    #[error("{}: fit: {what}; check that each row has the same point twice, the order and unit of the columns, and --fixed-scale", path.display())]
    Nonsense {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The fit.
    #[error("{}: {source}", path.display())]
    Fit {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: GeoreferenceError,
    },
    /// Warnings where they are errors.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// The result cannot be encoded.
    #[error(
        "the parameters cannot be encoded: {0}; this is a fault of the program: please report it"
    )]
    Encode(#[from] toml::ser::Error),
    /// The result cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Accuracy that counts where the file states none [m].
const SIGMA_M: f64 = 0.01; // [m]
/// Share of the points' spread above which their misfit says that they are not the same points: where no point can be blamed for it, and in
/// any case. No survey is so bad.
const NONSENSE: [f64; 2] = [0.1, 0.5];
/// Share of it above which the misfit is in doubt.
const DOUBT: f64 = 0.02;
/// Most bytes of a file of points.
const MOST_BYTES: u64 = 16 << 20; // [B]

/// Names under which a column is known.
const COLUMNS: [(&str, &[&str]); 15] = [
    ("name", &["name", "id", "point", "point_id", "gcp", "label"]),
    (
        "x",
        &[
            "x",
            "local_x",
            "x_local",
            "x_m",
            "local_x_m",
            "model_x",
            "local_east",
        ],
    ),
    (
        "y",
        &[
            "y",
            "local_y",
            "y_local",
            "y_m",
            "local_y_m",
            "model_y",
            "local_north",
        ],
    ),
    (
        "z",
        &[
            "z",
            "local_z",
            "z_local",
            "z_m",
            "local_z_m",
            "model_z",
            "local_up",
        ],
    ),
    (
        "east",
        &["east", "easting", "e", "east_m", "easting_m", "map_x"],
    ),
    (
        "north",
        &["north", "northing", "n", "north_m", "northing_m", "map_y"],
    ),
    (
        "longitude",
        &["longitude", "lon", "lng", "longitude_deg", "lon_deg"],
    ),
    ("latitude", &["latitude", "lat", "latitude_deg", "lat_deg"]),
    (
        "height",
        &[
            "height",
            "h",
            "height_m",
            "h_m",
            "altitude",
            "alt",
            "elevation",
            "elevation_m",
            "map_z",
            "ellipsoidal_height",
            "orthometric_height",
        ],
    ),
    ("ecef_x", &["ecef_x", "ecef_x_m", "x_ecef", "x_ecef_m"]),
    ("ecef_y", &["ecef_y", "ecef_y_m", "y_ecef", "y_ecef_m"]),
    ("ecef_z", &["ecef_z", "ecef_z_m", "z_ecef", "z_ecef_m"]),
    ("sigma", &["sigma", "sigma_m", "accuracy", "accuracy_m"]),
    (
        "sigma_ground",
        &[
            "sigma_ground",
            "sigma_ground_m",
            "sigma_horizontal",
            "sigma_horizontal_m",
            "sigma_xy",
        ],
    ),
    (
        "sigma_height",
        &[
            "sigma_height",
            "sigma_height_m",
            "sigma_vertical",
            "sigma_vertical_m",
            "sigma_z",
        ],
    ),
];

/// The points of a file.
struct Survey {
    points: Vec<ControlPoint>,
    /// The system of their places on the Earth.
    crs: Crs,
    /// Whether the file states how exact they are.
    stated: bool,
    /// What was taken for granted.
    notes: Notes,
}

/// The points of a file.
fn read(arguments: &Arguments) -> Result<Survey, GeorefError> {
    let path = &arguments.points;
    let failed = |source| GeorefError::Read {
        path: path.clone(),
        source,
    };
    if std::fs::metadata(path).map_err(failed)?.len() > MOST_BYTES {
        let what = std::io::Error::other("it holds more than 16 MiB");
        return Err(failed(what));
    }
    let text = std::fs::read_to_string(path).map_err(failed)?;
    parse(&text, path, arguments)
}

/// The system of the places on the Earth, over what the heading of the heights says they are over.
fn system(
    name: &str,
    heading: Option<&str>,
    arguments: &Arguments,
    notes: &mut Notes,
) -> Result<Crs, CrsError> {
    let mut crs = Crs::parse(name)?;
    let kind = match heading.map(str::to_lowercase).as_deref() {
        Some("orthometric_height") => Some("geoid"),
        Some("ellipsoidal_height") => Some("ellipsoid"),
        _ => None,
    };
    if let Some(kind) = kind {
        let over = matches!(crs.heights(), Heights::Geoid(_));
        if !crs.heights_are_stated() {
            crs = crs.with_vertical(kind)?;
        } else if over != (kind == "geoid") {
            let what = format!(
                "it says heights over the {kind}, but {} counts: {}",
                crs.name(),
                crs.heights_in_words()
            );
            notes.assume(
                "column of heights",
                what,
                "mend the heading, or name another --crs",
            );
        }
    }
    if let Some(height_m) = arguments.geoid_height {
        crs = crs.with_geoid_height(height_m);
    }
    note_heights(&crs, notes);
    Ok(crs)
}

/// Notes columns that are not used.
fn unused(headings: &csv::StringRecord, used: &[usize], notes: &mut Notes) {
    let other =
        (headings.iter().enumerate()).filter(|(k, name)| !used.contains(k) && !name.is_empty());
    let names: Vec<_> = other.map(|(_, name)| format!("'{name}'")).collect();
    if !names.is_empty() {
        let what = format!("{} mean nothing here and are not used", names.join(", "));
        notes.assume(
            "columns",
            what,
            "rename them if they hold something (boresight georef --help)",
        );
    }
}

/// The points of a text.
fn parse(text: &str, path: &Path, arguments: &Arguments) -> Result<Survey, GeorefError> {
    let mut notes = Notes::default();
    let wrong = |line: u64, what: String| GeorefError::Line {
        path: path.into(),
        line,
        what,
    };
    let text = text.trim_start_matches('\u{feff}');
    let first = text
        .lines()
        .find(|line| !line.starts_with('#'))
        .unwrap_or("");
    let most = [',', ';', '\t']
        .into_iter()
        .max_by_key(|c| first.matches(*c).count());
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(most.map_or(b',', |c| c as u8))
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let headings = reader
        .headers()
        .map_err(|error| wrong(1, error.to_string()))?
        .clone();
    let column = |name: &str| {
        let (_, known) = COLUMNS.iter().find(|(own, _)| *own == name)?;
        let has = |heading: &str| known.contains(&heading.to_lowercase().as_str());
        headings.iter().position(has)
    };
    let three = |names: [&str; 3]| Some([column(names[0])?, column(names[1])?, column(names[2])?]);
    let heads = "headings are x, y, z for the model, and east, north, height or longitude, latitude, height or ecef_x, ecef_y, ecef_z for the Earth";
    let local = three(["x", "y", "z"]);
    let (earth, default) = if let Some(found) = three(["ecef_x", "ecef_y", "ecef_z"]) {
        (Some(found), Some("EPSG:4978"))
    } else if let Some(found) = three(["longitude", "latitude", "height"]) {
        (Some(found), Some("WGS84"))
    } else {
        (three(["east", "north", "height"]), None)
    };
    let (Some(local), Some(earth)) = (local, earth) else {
        return Err(wrong(1, format!("columns are missing; {heads}")));
    };
    let name = arguments.crs.as_deref().or(default);
    let name = name.ok_or_else(|| {
        wrong(
            1,
            "east and north are of which system? name it with --crs EPSG:…".into(),
        )
    })?;
    let crs = system(name, headings.get(earth[2]), arguments, &mut notes)?;
    let kinds = [crs.is_geocentric(), crs.is_geographic(), true];
    let kind = kinds.iter().position(|kind| *kind).unwrap_or(2);
    let given = [Some("EPSG:4978"), Some("WGS84"), None]
        .iter()
        .position(|kind| *kind == default);
    if given != Some(kind) {
        let have = [
            "ecef_x, ecef_y, ecef_z",
            "longitude, latitude, height",
            "east, north, height",
        ];
        let what = format!(
            "{} has coordinates {}; name the columns so, or another --crs",
            crs.name(),
            have[kind]
        );
        return Err(wrong(1, what));
    }
    let mut points = Vec::new();
    let sigmas = [["sigma_ground", "sigma"], ["sigma_height", "sigma"]];
    let sigmas = sigmas.map(|names| names.iter().find_map(|name| column(name)));
    let mut used = [local, earth].concat();
    used.extend(sigmas.iter().flatten().chain(column("name").iter()));
    unused(&headings, &used, &mut notes);
    for (index, row) in reader.records().enumerate() {
        let row = row.map_err(|error| {
            wrong(
                error.position().map_or(0, csv::Position::line),
                error.to_string(),
            )
        })?;
        let line = row.position().map_or(0, csv::Position::line);
        let number = |k: usize| {
            let text = row.get(k).unwrap_or("");
            let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
            value.ok_or_else(|| wrong(line, format!("{} = '{text}' is no number", &headings[k])))
        };
        let vector = |k: [usize; 3]| {
            Ok::<_, GeorefError>(DVec3::new(number(k[0])?, number(k[1])?, number(k[2])?))
        };
        let mut sigma_m = [SIGMA_M; 2];
        for (sigma_m, k) in sigma_m.iter_mut().zip(sigmas) {
            if let Some(k) = k {
                *sigma_m = number(k)?;
            }
            if *sigma_m <= 0.0 {
                return Err(wrong(
                    line,
                    "an accuracy is a positive number of metres".into(),
                ));
            }
        }
        let own = column("name")
            .and_then(|k| row.get(k))
            .filter(|name| !name.is_empty());
        points.push(ControlPoint {
            name: own.map_or_else(|| (index + 1).to_string(), str::to_string),
            r_local: vector(local)?,
            r_ecef_m: crs
                .to_ecef(vector(earth)?)
                .map_err(|error| wrong(line, error.to_string()))?,
            sigma_m,
        });
    }
    Ok(Survey {
        points,
        crs,
        stated: sigmas.iter().any(Option::is_some),
        notes,
    })
}

/// A number rounded to significant digits; what is far below any accuracy is zero.
fn digits(value: f64, count: i32) -> f64 {
    if value.abs() < 1e-20 {
        return 0.0;
    }
    let unit = 10_f64.powi(value.abs().log10().floor() as i32 + 1 - count);
    (value / unit).round() * unit
}

/// A fitted parameter.
#[derive(Serialize)]
struct ParameterToml {
    name: &'static str,
    value: f64,
    sigma: f64,
}

/// A point and its residual.
#[derive(Serialize)]
struct PointToml {
    name: String,
    used: bool,
    residual_enu_m: [f64; 3],
    residual_m: f64,
}

/// How good a fit is.
#[derive(Serialize)]
struct FitToml {
    version: &'static str,
    mode: &'static str,
    crs: String,
    heights: String,
    rms_m: f64,
    largest_m: f64,
    degrees_of_freedom: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma0: Option<f64>,
    /// Whether the covariance is scaled with the residuals, or follows from the stated accuracies alone.
    covariance_from: &'static str,
    warnings: Vec<String>,
    suspects: Vec<String>,
    covariance: Vec<Vec<f64>>,
}

/// The whole file.
#[derive(Serialize)]
struct ResultToml {
    placement: Parameters,
    fit: FitToml,
    parameters: Vec<ParameterToml>,
    points: Vec<PointToml>,
}

/// A placed model.
#[derive(Debug)]
pub struct Georeferenced {
    /// The fit.
    pub fit: Fit,
    /// All points, those left out too.
    pub points: Vec<ControlPoint>,
    /// Which of them the fit uses.
    pub used: Vec<bool>,
    /// What is wrong with points, in words.
    pub suspects: Vec<String>,
    /// What was taken for granted of the file.
    pub warnings: Vec<Warning>,
    crs: Crs,
    stated: bool,
}

/// Fits a model's placement, and tells what it took for granted.
pub fn georeference(arguments: &Arguments) -> Result<Georeferenced, GeorefError> {
    let found = place(read(arguments)?, arguments)?;
    warning::tell(&found.warnings)?;
    Ok(found)
}

/// Refuses a fit that means nothing: one whose points misfit by a good part of their spread, or whose centre is not on the Earth.
fn sensible(fit: &Fit, points: &[ControlPoint], blamed: bool) -> Result<(), String> {
    let spread_m = spread_m(points);
    if fit.rms_m > NONSENSE[usize::from(blamed)] * spread_m {
        return Err(format!(
            "residuals of {:.1} m rms among points that spread by {spread_m:.1} m are no fit",
            fit.rms_m
        ));
    }
    let height_m = fit.site.origin().height_m;
    if !HEIGHTS_M.contains(&height_m) || !RADII_M.contains(&fit.placement.r_ecef_m.length()) {
        return Err(format!(
            "its centre would lie {height_m:.0} m over the ellipsoid, as its points lie {spread_m:.0} m apart"
        ));
    }
    Ok(())
}

/// How far points lie from their middle (rms) [m].
fn spread_m(points: &[ControlPoint]) -> f64 {
    let count = points.len().max(1) as f64;
    let middle = points.iter().map(|point| point.r_ecef_m).sum::<DVec3>() / count;
    let squares = points
        .iter()
        .map(|point| point.r_ecef_m.distance_squared(middle));
    (squares.sum::<f64>() / count).sqrt()
}

/// Fits a placement to points.
fn place(survey: Survey, arguments: &Arguments) -> Result<Georeferenced, GeorefError> {
    let Survey {
        points,
        crs,
        stated,
        notes,
    } = survey;
    let mode = match (arguments.paper, arguments.fixed_scale) {
        (true, _) => Mode::Paper,
        (_, true) => Mode::FixedScale,
        _ => Mode::Seven,
    };
    let wrong = |source| GeorefError::Fit {
        path: arguments.points.clone(),
        source,
    };
    let found = suspects(&points, mode).map_err(wrong)?;
    let mut used = vec![true; points.len()];
    let name = |k: usize| &points[k].name;
    let mut words = Vec::new();
    for suspect in &found {
        let left = if arguments.robust {
            "left out"
        } else {
            "kept (--robust leaves out)"
        };
        match *suspect {
            Suspect::Swapped(i, j) => {
                words.push(format!("{} and {} look swapped; {left}", name(i), name(j)));
                (used[i], used[j]) = (!arguments.robust, !arguments.robust);
            }
            Suspect::Off(i, off) => {
                words.push(format!(
                    "{} lies elsewhere than the others say: {:+.3} m east, {:+.3} m north, {:+.3} m up; {left}",
                    name(i), off.x, off.y, off.z
                ));
                used[i] = !arguments.robust;
            }
        }
    }
    let taken: Vec<_> = points
        .iter()
        .zip(&used)
        .filter(|(_, used)| **used)
        .map(|(point, _)| point.clone())
        .collect();
    let mut fit = fit(&taken, mode).map_err(wrong)?;
    let path = &arguments.points;
    let nonsense = |what| GeorefError::Nonsense {
        path: path.clone(),
        what,
    };
    sensible(&fit, &taken, !words.is_empty()).map_err(nonsense)?;
    let share = fit.rms_m / spread_m(&taken);
    if share > DOUBT {
        fit.warnings.push(format!(
            "the residuals are {:.0} % of the points' spread: the model has another shape or unit, or points do not belong together",
            100.0 * share
        ));
    }
    Ok(Georeferenced {
        fit,
        points,
        used,
        suspects: words,
        warnings: notes.warnings(path),
        crs,
        stated,
    })
}

impl Georeferenced {
    /// Surveyed less fitted place of a point: east, north, up [m].
    fn residual_enu_m(&self, point: &ControlPoint) -> DVec3 {
        let fitted = self.fit.placement.to_ecef(point.r_local);
        self.fit.site.q_ecef_enu().inverse() * (point.r_ecef_m - fitted)
    }

    /// What the covariance is multiplied with: the residuals' own size, but where the file states accuracies, or nothing is left to
    /// judge them by.
    fn variance(&self) -> (f64, &'static str) {
        match self.fit.sigma0 {
            Some(sigma0) if !self.stated => (sigma0.powi(2), "residuals"),
            _ => (1.0, "stated accuracies"),
        }
    }

    /// Whether no point is in doubt that the fit uses, and the points fit.
    pub fn sound(&self) -> bool {
        let kept = (self.points.iter().zip(&self.used)).filter(|(_, used)| **used);
        let kept: Vec<_> = kept.map(|(point, _)| point.clone()).collect();
        let fits = self.fit.rms_m <= DOUBT * spread_m(&kept);
        fits && (self.suspects.is_empty() || self.used.contains(&false))
    }

    /// Free parameters with one sigma: place of the centre, turn and scale.
    fn parameters(&self) -> Vec<ParameterToml> {
        let (variance, _) = self.variance();
        let placement = &self.fit.placement;
        let turn = (self.fit.site.q_ecef_enu().inverse() * placement.q_ecef_local).to_scaled_axis();
        let center = self.fit.site.ecef_to_enu(placement.r_ecef_m);
        let value = |name: &str| match name {
            "east_m" => center.x,
            "north_m" => center.y,
            "up_m" => center.z,
            "about_east_rad" => turn.x,
            "about_north_rad" => turn.y,
            "about_up_rad" => turn.z,
            _ => placement.scale,
        };
        let one = |(k, name): (usize, &'static str)| ParameterToml {
            name,
            value: (value(name) * 1e12).round() / 1e12,
            sigma: digits((self.fit.covariance[(k, k)] * variance).sqrt(), 6),
        };
        self.fit
            .mode
            .names()
            .into_iter()
            .enumerate()
            .map(one)
            .collect()
    }

    /// The parameter file.
    pub fn to_toml(&self) -> Result<String, GeorefError> {
        let (variance, from) = self.variance();
        let points = self.points.iter().zip(&self.used).map(|(point, used)| {
            let residual_enu_m = self.residual_enu_m(point);
            PointToml {
                name: point.name.clone(),
                used: *used,
                residual_enu_m: residual_enu_m.into(),
                residual_m: residual_enu_m.length(),
            }
        });
        let rows = self.fit.covariance.row_iter();
        let result = ResultToml {
            placement: self.fit.placement.into(),
            fit: FitToml {
                version: crate::VERSION,
                mode: self.mode(),
                crs: self.crs.name().into(),
                heights: self.crs.heights_in_words(),
                rms_m: self.fit.rms_m,
                largest_m: self.largest_m(),
                degrees_of_freedom: self.fit.degrees_of_freedom,
                sigma0: self.fit.sigma0,
                covariance_from: from,
                warnings: self.fit.warnings.clone(),
                suspects: self.suspects.clone(),
                covariance: rows
                    .map(|row| row.iter().map(|v| digits(v * variance, 6)).collect())
                    .collect(),
            },
            parameters: self.parameters(),
            points: points.collect(),
        };
        Ok(toml::to_string(&result)?)
    }

    fn mode(&self) -> &'static str {
        match self.fit.mode {
            Mode::Seven => "seven parameters",
            Mode::FixedScale => "six parameters, scale 1",
            Mode::Paper => "five parameters, one angle about the vertical (paper, eq. 3)",
        }
    }

    fn largest_m(&self) -> f64 {
        self.fit
            .residuals_enu_m
            .iter()
            .map(|r| r.length())
            .fold(0.0, f64::max)
    }

    /// What the command prints.
    pub fn to_text(&self) -> String {
        let (fit, used) = (&self.fit, self.used.iter().filter(|used| **used).count());
        let origin = fit.site.origin();
        let mut text = format!(
            "{}, {} of {} points, {}, {}\ncentre  {:.9}°, {:.9}°, {:.3} m over the ellipsoid\n\n",
            self.mode(),
            used,
            self.points.len(),
            self.crs.name(),
            self.crs.heights_in_words(),
            origin.latitude_rad.to_degrees(),
            origin.longitude_rad.to_degrees(),
            origin.height_m,
        );
        for parameter in self.parameters() {
            let (value, sigma) = (parameter.value, parameter.sigma);
            let line = match parameter.name {
                name if name.ends_with("_rad") => {
                    let name = name.trim_end_matches("_rad").replace('_', " ");
                    format!(
                        "{name:<12} {:>14.6}° ± {:.6}°",
                        value.to_degrees(),
                        sigma.to_degrees()
                    )
                }
                "scale" => format!(
                    "{:<12} {value:>15.9} ± {:.1} ppm",
                    "scale",
                    1e6 * sigma / value
                ),
                name => format!(
                    "{:<12} {value:>14.4} m ± {sigma:.4} m",
                    name.trim_end_matches("_m")
                ),
            };
            let _ = writeln!(text, "{line}");
        }
        let _ = writeln!(
            text,
            "\n{:<12} {:>9} {:>9} {:>9} {:>9}",
            "point", "east m", "north m", "up m", "all m"
        );
        for (point, used) in self.points.iter().zip(&self.used) {
            let r = self.residual_enu_m(point);
            let mark = if *used { "" } else { "  left out" };
            let _ = writeln!(
                text,
                "{:<12} {:>9.4} {:>9.4} {:>9.4} {:>9.4}{mark}",
                point.name,
                r.x,
                r.y,
                r.z,
                r.length()
            );
        }
        let sigma0 = fit
            .sigma0
            .filter(|_| self.stated)
            .map_or(String::new(), |s| {
                format!(", {s:.2} times the stated accuracy")
            });
        let _ = writeln!(
            text,
            "\nresiduals    {:.4} m rms, {:.4} m at most, {} degrees of freedom{sigma0}",
            fit.rms_m,
            self.largest_m(),
            fit.degrees_of_freedom
        );
        for warning in self.suspects.iter().chain(&fit.warnings) {
            let _ = writeln!(text, "warning: {warning}");
        }
        text
    }

    /// Writes the parameter file.
    pub fn write(&self, path: &Path) -> Result<(), GeorefError> {
        Ok(output::put(path, self.to_toml()?)?)
    }
}

#[cfg(test)]
#[path = "georef/tests.rs"]
mod tests;
