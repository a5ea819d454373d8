//! Walls of layers before what they cover.

use super::material::{
    ABS, ALUMINIUM_6061, CARBON_FIBRE, ELECTRODES, GLASS_FIBRE, MAGNET, Material, POLYCARBONATE,
    POUCH_FOIL, STEEL, paint_absorptivity,
};

/// One layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// What it is made of.
    pub material: &'static Material,
    /// Its thickness [m].
    pub thickness_m: f64,
    /// Air between it and the layer before it [m].
    pub gap_m: f64,
}

/// A wall, outermost layer first, and what fails in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skin {
    /// Name for reports.
    pub name: &'static str,
    /// Layers from the outside inwards.
    pub layers: &'static [Layer],
    /// Whether the paint decides how much light the outermost layer absorbs.
    pub is_painted: bool,
    /// The layer whose limit counts, and how deep in it [-]: 0 its face, 1 its back.
    pub fails_at: (usize, f64),
    /// Temperature there at which the function is lost [K].
    pub limit_k: f64,
}

/// What lies in the room behind a shell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Room {
    /// A circuit board 5 mm behind it.
    Board,
    /// Nothing: a hollow arm, whose wall bears.
    Hollow,
}

const fn layer(material: &'static Material, thickness_m: f64) -> Layer {
    Layer {
        material,
        thickness_m,
        gap_m: 0.0,
    }
}

/// A board of 1.6 mm behind 5 mm of air.
const BOARD: Layer = Layer {
    material: &GLASS_FIBRE,
    thickness_m: 1.6e-3,
    gap_m: 5e-3,
};

/// Temperature at which a board fails [K]: its solder (SAC305) melts at 217 °C.
const SOLDER_K: f64 = 490.0;

/// Polycarbonate shell of 1.5 mm over a board.
pub const POLYCARBONATE_SHELL: Skin = Skin {
    name: "polycarbonate shell",
    layers: &[layer(&POLYCARBONATE, 1.5e-3), BOARD],
    is_painted: true,
    fails_at: (1, 0.0),
    limit_k: SOLDER_K,
};

/// ABS shell of 2 mm over a board.
pub const ABS_SHELL: Skin = Skin {
    name: "ABS shell",
    layers: &[layer(&ABS, 2e-3), BOARD],
    ..POLYCARBONATE_SHELL
};

/// Carbon-fibre plate of 1.5 mm over a board.
pub const CARBON_EPOXY: Skin = Skin {
    name: "carbon-fibre epoxy",
    layers: &[layer(&CARBON_FIBRE, 1.5e-3), BOARD],
    is_painted: false,
    ..POLYCARBONATE_SHELL
};

/// Pouch of a lithium-polymer cell: its foil over 4 mm of electrodes, whose first separator lies close to the face.
pub const LIPO_POUCH: Skin = Skin {
    name: "LiPo pouch",
    layers: &[layer(&POUCH_FOIL, 0.15e-3), layer(&ELECTRODES, 4e-3)],
    is_painted: false,
    fails_at: (1, 0.05),
    limit_k: ELECTRODES.softens_k,
};

/// Such a pouch half a millimetre behind the plastic shell of its pack.
pub const SHELLED_POUCH: Skin = Skin {
    name: "LiPo pouch in its shell",
    layers: &[
        layer(&POLYCARBONATE, 1.5e-3),
        Layer {
            material: &POUCH_FOIL,
            thickness_m: 0.15e-3,
            gap_m: 0.5e-3,
        },
        layer(&ELECTRODES, 4e-3),
    ],
    is_painted: true,
    fails_at: (2, 0.05),
    limit_k: ELECTRODES.softens_k,
};

/// Bell of an outrunner motor: a 1 mm steel flux ring over 1.5 mm of magnets.
pub const MOTOR_BELL: Skin = Skin {
    name: "motor bell",
    layers: &[layer(&STEEL, 1e-3), layer(&MAGNET, 1.5e-3)],
    is_painted: false,
    fails_at: (1, 0.5),
    limit_k: MAGNET.softens_k,
};

/// Aluminium sheet of 1 mm over a board.
pub const ALUMINIUM: Skin = Skin {
    name: "aluminium",
    layers: &[layer(&ALUMINIUM_6061, 1e-3), BOARD],
    is_painted: false,
    ..POLYCARBONATE_SHELL
};

impl Skin {
    /// The wall as it stands before a room: a hollow one bears by itself, and fails where it softens half through.
    pub fn before(self, room: Room) -> Self {
        match (room, self.layers) {
            (Room::Hollow, [wall, Layer { gap_m, .. }]) if *gap_m > 1e-3 => Self {
                layers: &self.layers[..1],
                fails_at: (0, 0.5),
                limit_k: wall.material.softens_k,
                ..self
            },
            _ => self,
        }
    }

    /// Absorptivity of its face when new, for a paint of an albedo, at a wavelength [m].
    pub fn absorptivity(&self, albedo: f64, wavelength_m: f64) -> f64 {
        match (self.is_painted, self.layers.first()) {
            (true, _) => paint_absorptivity(albedo, wavelength_m),
            (false, Some(layer)) => layer.material.absorptivity,
            (false, None) => 0.0,
        }
    }

    /// Energy per area that a wide beam must bring until it fails [J/m²], black from the start, without loss and
    /// without the heat that runs on inwards: layers before the one that counts leave or warm through, and that one
    /// warms to its limit as deep as it counts, at least a quarter of a millimetre.
    pub fn energy_jpm2(&self, temperature_k: f64) -> f64 {
        /// Least depth that is warmed [m].
        const LEAST_M: f64 = 0.25e-3;
        let (counts, depth) = self.fails_at;
        let through = self.layers.windows(2).take(counts).map(|pair| {
            let [layer, next] = pair else { return 0.0 };
            let material = layer.material;
            // What is welded to the next layer warms it rather than leave.
            let each_jpkg = if next.gap_m > 0.0 && material.chars {
                material.specific_heat_jpkgk * (material.ablates_k - temperature_k)
                    + material.ablation_jpkg
            } else {
                material.specific_heat_jpkgk * (self.limit_k - temperature_k)
            };
            material.density_kgpm3 * layer.thickness_m * each_jpkg.max(0.0)
        });
        let last = self.layers.get(counts).map_or(0.0, |layer| {
            let depth_m = (depth * layer.thickness_m).max(LEAST_M);
            layer.material.capacity_jpm3k() * depth_m * (self.limit_k - temperature_k).max(0.0)
        });
        through.sum::<f64>() + last
    }
}
