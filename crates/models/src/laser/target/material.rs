//! Classes of materials, by handbook values.

/// What a layer is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Name for reports.
    pub name: &'static str,
    /// Density [kg/m³].
    pub density_kgpm3: f64,
    /// Specific heat [J/(kg K)].
    pub specific_heat_jpkgk: f64,
    /// Thermal conductivity through the layer [W/(m K)].
    pub through_wpmk: f64,
    /// Thermal conductivity along it [W/(m K)].
    pub along_wpmk: f64,
    /// Thermal emissivity [-].
    pub emissivity: f64,
    /// Absorptivity at 1 µm and 300 K where no paint decides it [-].
    pub absorptivity: f64,
    /// What a kelvin adds to the absorptivity [1/K].
    pub absorptivity_per_k: f64,
    /// Whether a painted or pigmented surface turns black where it ablates: polymers and their composites do.
    pub chars: bool,
    /// Temperature at which it stops bearing loads [K].
    pub softens_k: f64,
    /// Temperature at which it leaves: pyrolysis or melting [K].
    pub ablates_k: f64,
    /// Energy that takes a kilogram away once it is that hot [J/kg].
    pub ablation_jpkg: f64,
}

impl Material {
    /// Heat that warms a cubic metre by a kelvin [J/(m³ K)].
    pub fn capacity_jpm3k(&self) -> f64 {
        self.density_kgpm3 * self.specific_heat_jpkgk
    }
}

/// Absorptivity of char and soot (carbon black paints reach 0.95; 0.9 is an assumption good to 0.05).
pub const CHAR_ABSORPTIVITY: f64 = 0.9;

/// Polycarbonate: 1200 kg/m³, 1250 J/(kg K), 0.20 W/(m K), glass transition 147 °C (Mark, Polymer Data Handbook, Oxford
/// 1999); gasifies near 750 K at some 2.1 MJ/kg from 300 K on (Tewarson, SFPE Handbook; recalled), of which 0.56 heat it.
pub const POLYCARBONATE: Material = Material {
    name: "polycarbonate",
    density_kgpm3: 1200.0,
    specific_heat_jpkgk: 1250.0,
    through_wpmk: 0.20,
    along_wpmk: 0.20,
    emissivity: 0.9,
    absorptivity: 0.9,
    absorptivity_per_k: 0.0,
    chars: true,
    softens_k: 420.0,
    ablates_k: 750.0,
    ablation_jpkg: 1.5e6,
};

/// ABS: 1050 kg/m³, 1400 J/(kg K), 0.18 W/(m K), glass transition 105 °C (Mark, styrene copolymers); gasifies near 690 K
/// at some 3.2 MJ/kg from 300 K on (Tewarson, SFPE Handbook; recalled), of which 0.55 heat it.
pub const ABS: Material = Material {
    name: "ABS",
    density_kgpm3: 1050.0,
    specific_heat_jpkgk: 1400.0,
    through_wpmk: 0.18,
    along_wpmk: 0.18,
    softens_k: 378.0,
    ablates_k: 690.0,
    ablation_jpkg: 2.65e6,
    ..POLYCARBONATE
};

/// Carbon-fibre epoxy: 1400 kg/m³, 935 J/(kg K), 0.87 and 11.1 W/(m K) across and along its fibres (Incropera, table A.2,
/// graphite-fibre epoxy at 300 K); the matrix softens at the 180 °C of a 177 °C cure (CMH-17). It absorbs some 0.8 from 600
/// to 1100 nm (Freitag 2014). Its fibres stay until they sublime at 3900 K and some 43 MJ/kg (carbon; recalled).
pub const CARBON_FIBRE: Material = Material {
    name: "carbon-fibre epoxy",
    density_kgpm3: 1400.0,
    specific_heat_jpkgk: 935.0,
    through_wpmk: 0.87,
    along_wpmk: 11.1,
    emissivity: 0.85,
    absorptivity: 0.8,
    absorptivity_per_k: 0.0,
    chars: false,
    softens_k: 453.0,
    ablates_k: 3900.0,
    ablation_jpkg: 4.3e7,
};

/// Glass-fibre epoxy of a circuit board: 1850 kg/m³, 1100 J/(kg K), 0.3 and 0.8 W/(m K), with its parts and copper planes
/// left out (handbook values of FR4). It ablates some 10 µg/J (Frontiers in Physics 2023, 1230004).
pub const GLASS_FIBRE: Material = Material {
    name: "glass-fibre epoxy",
    density_kgpm3: 1850.0,
    specific_heat_jpkgk: 1100.0,
    through_wpmk: 0.3,
    along_wpmk: 0.8,
    emissivity: 0.9,
    absorptivity: 0.8,
    absorptivity_per_k: 0.0,
    chars: true,
    softens_k: 403.0,
    ablates_k: 1100.0,
    ablation_jpkg: 1e8,
};

/// Foil of a pouch cell, nylon and aluminium as one: 1800 kg/m³ and 1100 J/(kg K) by mass, 0.3 and 40 W/(m K); an
/// assumption. Melts at the 220 °C of its nylon; some 1 MJ/kg take it away.
pub const POUCH_FOIL: Material = Material {
    name: "pouch foil",
    density_kgpm3: 1800.0,
    specific_heat_jpkgk: 1100.0,
    through_wpmk: 0.3,
    along_wpmk: 40.0,
    emissivity: 0.9,
    absorptivity: 0.7,
    absorptivity_per_k: 0.0,
    chars: true,
    softens_k: 493.0,
    ablates_k: 750.0,
    ablation_jpkg: 1e6,
};

/// Stack of electrodes: about 2200 kg/m³ and 1000 J/(kg K), 1 and 25 W/(m K) across and along its foils (typical of
/// published cells; an assumption good to 30 %). Its polyethylene separator melts at 130 °C (Feng et al., Energy Storage
/// Materials 10, 246, 2018).
pub const ELECTRODES: Material = Material {
    name: "electrodes",
    density_kgpm3: 2200.0,
    specific_heat_jpkgk: 1000.0,
    through_wpmk: 1.0,
    along_wpmk: 25.0,
    emissivity: 0.9,
    absorptivity: 0.9,
    absorptivity_per_k: 0.0,
    chars: false,
    softens_k: 403.0,
    ablates_k: 1500.0,
    ablation_jpkg: 1e7,
};

/// Mild steel, dark: 7850 kg/m³, 450 J/(kg K), 50 W/(m K), melts at 1750 K and 270 kJ/kg (handbook values). Absorptivity
/// 0.5 of an oxidised or painted bell is an assumption good to 0.2.
pub const STEEL: Material = Material {
    name: "steel",
    density_kgpm3: 7850.0,
    specific_heat_jpkgk: 450.0,
    through_wpmk: 50.0,
    along_wpmk: 50.0,
    emissivity: 0.8,
    absorptivity: 0.5,
    absorptivity_per_k: 0.0,
    chars: false,
    softens_k: 900.0,
    ablates_k: 1750.0,
    ablation_jpkg: 2.7e5,
};

/// Sintered NdFeB: 7500 kg/m³, 450 J/(kg K), 9 W/(m K) (handbook values); SH grades work up to 150 °C.
pub const MAGNET: Material = Material {
    name: "magnet",
    density_kgpm3: 7500.0,
    through_wpmk: 9.0,
    along_wpmk: 9.0,
    softens_k: 423.0,
    ..STEEL
};

/// Aluminium 6061, anodised: 2700 kg/m³, 896 J/(kg K), 167 W/(m K), solidus 855 K, 397 kJ/kg to melt (ASM Metals Handbook,
/// vol. 2). Absorptivity 0.14 (the solar value, Incropera, table A.12) rises by half on the way to melting (Drude's law
/// with a resistance that doubles; an assumption).
pub const ALUMINIUM_6061: Material = Material {
    name: "aluminium",
    density_kgpm3: 2700.0,
    specific_heat_jpkgk: 896.0,
    through_wpmk: 167.0,
    along_wpmk: 167.0,
    emissivity: 0.84,
    absorptivity: 0.14,
    absorptivity_per_k: 1.2e-4,
    chars: false,
    softens_k: 600.0,
    ablates_k: 880.0,
    ablation_jpkg: 3.97e5,
};

/// Absorptivity of a paint or pigment of a visible albedo [-], at a wavelength [m].
///
/// Titanium white and carbon black keep from 0.8 to 1.1 µm what they have in the visible. Beyond, white scatters less
/// and polymers absorb themselves: at 2 µm all is taken to absorb 0.9, in between by a straight line (an assumption).
pub fn paint_absorptivity(albedo: f64, wavelength_m: f64) -> f64 {
    /// Where white begins to fail, and where it has [m].
    const FAILS_M: [f64; 2] = [1.2e-6, 2.0e-6];
    /// Plastics reflect 5 to 10 % at their very surface.
    const MOST: f64 = 0.93;
    let [from_m, to_m] = FAILS_M;
    let share = ((wavelength_m - from_m) / (to_m - from_m)).clamp(0.0, 1.0);
    let visible = (1.0 - albedo).min(MOST);
    (1.0 - share) * visible + share * visible.max(0.9)
}
