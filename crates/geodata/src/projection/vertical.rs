//! EPSG's register of vertical and compound systems (assets/epsg, written by `scripts/projections.py --registers` from PROJ's
//! database), and the vertical codes of GeoTIFF 1.0, which surveys still write.

use super::error::CrsError;

/// What heights are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heights {
    /// WGS 84's ellipsoid.
    Ellipsoid,
    /// A geoid, or the national levelling that stands for it, by its name.
    Geoid(&'static str),
}

/// Code, datum, metres in its unit (negative: depths), name.
const VERTICAL: &str = include_str!(concat!(
    concat!(env!("CARGO_MANIFEST_DIR"), "/../.."),
    "/assets/epsg/vertical.csv"
));
/// Code, horizontal system, vertical system or `ellipsoid`.
const COMPOUND: &str = include_str!(concat!(
    concat!(env!("CARGO_MANIFEST_DIR"), "/../.."),
    "/assets/epsg/compound.csv"
));

/// Ellipsoids whose heights GeoTIFF 1.0 has codes for (5001 to 5034), by the code: those of GRS 80 (5019), WGS 84 (5030) and the
/// gravity models after it are WGS 84's to a millimetre.
const ELLIPSOIDS: [(u32, &str); 28] = [
    (5001, "Airy 1830"),
    (5002, "Airy Modified 1849"),
    (5003, "Australian National Spheroid"),
    (5004, "Bessel 1841"),
    (5005, "Bessel Modified"),
    (5006, "Bessel Namibia"),
    (5007, "Clarke 1858"),
    (5008, "Clarke 1866"),
    (5010, "Clarke 1880 (Benoit)"),
    (5011, "Clarke 1880 (IGN)"),
    (5012, "Clarke 1880 (RGS)"),
    (5013, "Clarke 1880 (Arc)"),
    (5014, "Clarke 1880 (SGA 1922)"),
    (5015, "Everest 1830 (1937)"),
    (5016, "Everest 1830 (1967)"),
    (5017, "Everest 1830 (1975)"),
    (5018, "Everest 1830 Modified"),
    (5020, "Helmert 1906"),
    (5021, "Indonesian National Spheroid"),
    (5022, "International 1924"),
    (5023, "International 1967"),
    (5024, "Krassowsky 1940"),
    (5025, "NWL 9D"),
    (5026, "NWL 10D"),
    (5027, "Plessis 1817"),
    (5028, "Struve 1860"),
    (5029, "War Office"),
    (5034, "Clarke 1880"),
];
/// Those that are WGS 84's.
const WGS84: [u32; 5] = [5019, 5030, 5031, 5032, 5033];

/// What a vertical code says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vertical {
    /// What its heights are counted from.
    pub heights: Heights,
    /// Metres in its unit.
    pub unit_m: f64,
}

/// The fields of a register's rows.
fn rows<const N: usize>(register: &'static str) -> impl Iterator<Item = [&'static str; N]> {
    let lines = register.lines().skip(1);
    lines.filter_map(|line| {
        let mut fields = line.splitn(N, ',');
        let row: [&str; N] = std::array::from_fn(|_| fields.next().unwrap_or(""));
        Some(row).filter(|row| row.iter().all(|field| !field.is_empty()))
    })
}

/// The vertical system of a code: EPSG's, one of GeoTIFF 1.0 (5001 to 5034: heights over an ellipsoid), or, as GeoTIFF 1.0 has them (5101
/// to 5106), the number of its datum.
pub(super) fn vertical(text: &str) -> Result<Vertical, CrsError> {
    let unknown = || CrsError::Vertical(text.into());
    let code: u32 = text.parse().map_err(|_| unknown())?;
    let ellipsoid = Vertical {
        heights: Heights::Ellipsoid,
        unit_m: 1.0,
    };
    if WGS84.contains(&code) || is_three_dimensional(code) {
        return Ok(ellipsoid);
    }
    let own = |(of, _): &&(u32, &str)| *of == code;
    if let Some((_, name)) = ELLIPSOIDS.iter().find(own) {
        return Err(CrsError::Ellipsoid { code, name });
    }
    let system = |[_, _, unit_m, name]: [&'static str; 4]| (unit_m.parse().ok(), name);
    let is = |row: &[&str; 4]| row[0] == text;
    // A datum's number means its heights in metres.
    let of = |row: &[&str; 4]| row[1] == text && row[2] == "1";
    let found = (rows::<4>(VERTICAL).find(is)).or_else(|| rows::<4>(VERTICAL).find(of));
    let (unit_m, name) = found.map(system).ok_or_else(unknown)?;
    match unit_m {
        Some(unit_m) if unit_m > 0.0 => Ok(Vertical {
            heights: Heights::Geoid(name),
            unit_m,
        }),
        Some(_) => Err(CrsError::Depth { code, name }),
        None => Err(unknown()),
    }
}

/// Whether a code is that of a system whose third coordinate is the height over its ellipsoid.
fn is_three_dimensional(code: u32) -> bool {
    parts(code).is_some_and(|(_, vertical)| vertical == "ellipsoid")
}

/// Horizontal code and vertical one (or `ellipsoid`) of a compound or three-dimensional system.
pub(super) fn parts(code: u32) -> Option<(u16, &'static str)> {
    let text = code.to_string();
    let [_, horizontal, vertical] = rows::<3>(COMPOUND).find(|row| row[0] == text)?;
    Some((horizontal.parse().ok()?, vertical))
}

/// The code of the vertical system whose name stands in a text: the longest such name.
pub fn named_in(text: &str) -> Option<&'static str> {
    let text = text.to_lowercase();
    let within = |row: &[&str; 4]| {
        let name = row[3].to_lowercase();
        // A name as a whole word: HKPD, not the first letters of another.
        let [before, after] = match text.find(&name) {
            Some(at) => [
                text[..at].chars().next_back(),
                text[at + name.len()..].chars().next(),
            ],
            None => return false,
        };
        let inside = |c: Option<char>| c.is_some_and(char::is_alphanumeric);
        name.len() > 2 && !inside(before) && !inside(after)
    };
    let found = rows::<4>(VERTICAL).filter(within);
    found.max_by_key(|row| row[3].len()).map(|row| row[0])
}
