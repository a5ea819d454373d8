//! Classes of what flies, as detectors, data sets and evaluations name them.

use serde::{Deserialize, Serialize};

/// A class of flying objects: three of UAVs, five of what is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObjectClass {
    /// A small, agile racer flown by first-person view.
    Fpv,
    /// A camera or industrial UAV with four rotors.
    Quadcopter,
    /// An industrial UAV with six rotors.
    Hexacopter,
    /// A bird, flapping or gliding.
    Bird,
    /// An aeroplane with jets or propellers.
    Aeroplane,
    /// A manned helicopter.
    Helicopter,
    /// A balloon.
    Balloon,
    /// Anything else that moves through the air, such as leaves and scraps of paper.
    Other,
}

impl ObjectClass {
    /// Every class; UAVs come first.
    pub const ALL: [Self; 8] = [
        Self::Fpv,
        Self::Quadcopter,
        Self::Hexacopter,
        Self::Bird,
        Self::Aeroplane,
        Self::Helicopter,
        Self::Balloon,
        Self::Other,
    ];

    /// Its name in data sets, in a model's `classes` and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fpv => "fpv",
            Self::Quadcopter => "quadcopter",
            Self::Hexacopter => "hexacopter",
            Self::Bird => "bird",
            Self::Aeroplane => "aeroplane",
            Self::Helicopter => "helicopter",
            Self::Balloon => "balloon",
            Self::Other => "other",
        }
    }

    /// The class of this name, in any case; the spelling `airplane` is understood.
    pub fn of_name(name: &str) -> Option<Self> {
        let name = match name.to_ascii_lowercase() {
            name if name == "airplane" => Self::Aeroplane.name().to_owned(),
            name => name,
        };
        Self::ALL.into_iter().find(|class| class.name() == name)
    }

    /// Whether its members are UAVs.
    pub fn is_uav(self) -> bool {
        matches!(self, Self::Fpv | Self::Quadcopter | Self::Hexacopter)
    }

    /// Its category in data sets, from 1.
    pub fn category_id(self) -> u32 {
        self as u32 + 1
    }
}

/// Whether a class of this name counts as a UAV: all do but those that are known to be none, so that
/// a model with classes of its own (`uav`, `drone`, a maker's type) is heard.
pub fn is_uav(name: &str) -> bool {
    ObjectClass::of_name(name).is_none_or(ObjectClass::is_uav)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_their_own_and_unknown_ones_are_uavs() {
        for class in ObjectClass::ALL {
            assert_eq!(ObjectClass::of_name(class.name()), Some(class));
            assert_eq!(is_uav(class.name()), class.is_uav());
        }
        assert!(is_uav("uav") && is_uav("DJI") && is_uav(""));
        assert!(!is_uav("AIRPLANE") && !is_uav("Bird"));
        let ids: Vec<u32> = ObjectClass::ALL.map(ObjectClass::category_id).into();
        assert_eq!(ids, [1, 2, 3, 4, 5, 6, 7, 8]);
    }
}
