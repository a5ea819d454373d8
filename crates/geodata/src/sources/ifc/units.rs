//! Units of length and of plane angles that an IFC file assigns.

use super::model::{DEEPEST, Model};
use crate::sources::error::Fault;
use ifc_lite_core::units::try_si_prefix_multiplier;
use ifc_lite_core::{AttributeValue, DecodedEntity, IfcType, US_SURVEY_FOOT_M};

/// What mends a unit that is not understood.
const MEND: &str = "export it in metres (IfcSIUnit METRE)";

impl Model<'_> {
    /// Takes the units of length and of plane angles that the project assigns.
    ///
    /// Fails where one is assigned that is not understood.
    pub fn take_units(&mut self, kinds: &[(u32, IfcType)]) -> Result<(), Fault> {
        let of = |kind: IfcType| {
            let own = kinds.iter().find(move |(_, own)| *own == kind);
            own.map(|(id, _)| *id)
        };
        let project = of(IfcType::IfcProject).and_then(|id| self.entity(id));
        let assignment = project.and_then(|project| self.at(&project, 8));
        let assignment = assignment.or_else(|| self.entity(of(IfcType::IfcUnitAssignment)?));
        let units = assignment.map(|assignment| self.all(&assignment, 0));
        let mut length = None;
        for unit in units.unwrap_or_default() {
            match unit.get(1).and_then(AttributeValue::as_enum) {
                Some("LENGTHUNIT") if length.is_none() => length = Some(self.unit_m(&unit)?),
                Some("PLANEANGLEUNIT") if !self.angle_stated => {
                    self.angle_rad = self.unit(&unit, "RADIAN", DEEPEST)?;
                    self.angle_stated = true;
                }
                _ => {}
            }
        }
        if length.is_none() {
            let what = "no unit of length is assigned: taken as metres";
            let mend = "assign a LENGTHUNIT to the project";
            self.notes.assume("IfcUnitAssignment", what, mend);
        }
        self.unit_m = length.unwrap_or(1.0);
        Ok(())
    }

    /// Metres in a unit of length.
    pub fn unit_m(&mut self, unit: &DecodedEntity) -> Result<f64, Fault> {
        let found = self.unit(unit, "METRE", DEEPEST)?;
        let sound = (1e-7..1e5).contains(&found);
        let what = format!("a unit of {found} m is none of length for a building");
        sound
            .then_some(found)
            .ok_or_else(|| Fault::new(place(unit), what, MEND))
    }

    /// A named unit in the SI unit `base` without a prefix.
    pub fn unit(&mut self, unit: &DecodedEntity, base: &str, depth: usize) -> Result<f64, Fault> {
        let wrong = |what: String| Fault::new(place(unit), what, MEND);
        let depth = depth.checked_sub(1);
        let depth = depth.ok_or_else(|| wrong("units refer to each other in a circle".into()))?;
        match unit.ifc_type {
            IfcType::IfcSIUnit => {
                let name = unit.get(3).and_then(AttributeValue::as_enum);
                if name != Some(base) {
                    let what = format!("'{}' where {base} belongs", name.unwrap_or_default());
                    return Err(wrong(what));
                }
                let prefix = unit.get(2).and_then(AttributeValue::as_enum);
                prefix.map_or(Ok(1.0), |prefix| {
                    let known = try_si_prefix_multiplier(prefix);
                    known.ok_or_else(|| wrong(format!("the prefix '{prefix}' is not known")))
                })
            }
            IfcType::IfcConversionBasedUnit => {
                let name = unit.get_string(2).unwrap_or_default().to_string();
                let measure = self.at(unit, 3);
                if measure.is_none() && base == "METRE" {
                    let what = format!("'{name}' without a factor");
                    return named_unit_m(&name).ok_or_else(|| wrong(what));
                }
                let factor = measure.as_ref().and_then(|measure| measure.get_float(0));
                let factor = factor.filter(|f| f.is_finite() && *f > 0.0);
                let component = measure.and_then(|measure| self.at(&measure, 1));
                let both = factor.zip(component);
                let (factor, component) =
                    both.ok_or_else(|| wrong(format!("'{name}' without a factor of a unit")))?;
                let found = factor * self.unit(&component, base, depth)?;
                let meant = named_unit_m(&name).filter(|_| base == "METRE");
                if let Some(meant) = meant.filter(|meant| (found / meant - 1.0).abs() > 1e-3) {
                    let what = format!(
                        "'{name}' with a factor of {found} m instead of {meant} m: the factor counts"
                    );
                    self.notes.assume(place(unit), what, MEND);
                }
                Ok(found)
            }
            _ => Err(wrong(format!(
                "'{}' is a unit without a size",
                unit.get_string(2).unwrap_or_default()
            ))),
        }
    }
}

fn place(unit: &DecodedEntity) -> String {
    format!("#{} {}", unit.id, unit.ifc_type.name())
}

/// Metres in a unit of length by its name, as property sets state it.
pub fn named_unit_m(name: &str) -> Option<f64> {
    let word: String = name.chars().filter(|c| c.is_alphanumeric()).collect();
    let word = word.to_uppercase();
    let word = word.strip_suffix('S').unwrap_or(&word);
    Some(match word {
        "FOOT" | "FEET" | "FT" | "INTERNATIONALFOOT" => 0.3048,
        "USSURVEYFOOT" | "USSURVEYFEET" | "FOOTU" | "USFT" | "USFOOT" | "FTU" | "FOOTUSSURVEY" => {
            US_SURVEY_FOOT_M
        }
        "INCH" | "INCHE" | "IN" => 0.0254,
        "YARD" | "YD" => 0.9144,
        "MILE" => 1609.344,
        "M" => 1.0,
        "MM" => 0.001,
        "CM" => 0.01,
        "DM" => 0.1,
        "KM" => 1000.0,
        _ => {
            let metre = word
                .strip_suffix("METRE")
                .or_else(|| word.strip_suffix("METER"))?;
            match metre {
                "" => 1.0,
                prefix => try_si_prefix_multiplier(prefix)?,
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_have_names() {
        for (name, unit_m) in [
            ("METRE", Some(1.0)),
            ("metres", Some(1.0)),
            ("Millimeters", Some(0.001)),
            ("DECAMETRE", Some(10.0)),
            ("US survey foot", Some(1200.0 / 3937.0)),
            ("FOOT_US", Some(1200.0 / 3937.0)),
            ("us-ft", Some(1200.0 / 3937.0)),
            ("feet", Some(0.3048)),
            ("inches", Some(0.0254)),
            ("mm", Some(0.001)),
            ("SQUARE METRE", None),
            ("cubit", None),
            ("", None),
        ] {
            assert_eq!(named_unit_m(name), unit_m, "{name}");
        }
    }
}
