//! The unit's description, `modelDescription.xml` of FMI 3.0.

use super::variables::{Causality, STATES, TIME, Type, VARIABLES, Variable, reference};
use std::fmt::Write as _;

/// Name of the library without its ending.
pub const IDENTIFIER: &str = "boresight";
/// Name of the type of the engagement's states.
const STATE: &str = "EngagementState";

/// What a scenario says of its unit.
pub(super) struct Described<'a> {
    pub name: &'a str,
    pub description: &'a str,
    pub station: &'a str,
    /// What unit and library know each other by.
    pub token: &'a str,
    pub seed: u64,
    pub may_fire: bool,
    pub tick_hz: u32,
    pub duration_s: f64,
}

/// A text inside an attribute.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' | '\r' | '\t' => out.push(' '),
            c if c.is_control() => {}
            c => out.push(c),
        }
    }
    out
}

/// A variable's element.
fn element(variable: &Variable, described: &Described) -> String {
    let Variable {
        reference: number,
        name,
        description,
        of,
        causality,
    } = *variable;
    let (kind, unit) = match of {
        Type::Float64(unit) => ("Float64", unit),
        Type::Boolean => ("Boolean", ""),
        Type::UInt64 => ("UInt64", ""),
        Type::State => ("Enumeration", ""),
    };
    let (causality, variability, initial) = match causality {
        Causality::Parameter => ("parameter", "fixed", "initial=\"exact\" "),
        Causality::Input => ("input", varies(of), ""),
        Causality::Output => ("output", varies(of), "initial=\"calculated\" "),
    };
    let start = match number {
        reference::SEED => described.seed.to_string(),
        reference::FIRE => described.may_fire.to_string(),
        reference::DRIVE => false.to_string(),
        _ => "0".to_owned(),
    };
    let start = match causality {
        "output" => String::new(),
        _ => format!("start=\"{start}\" "),
    };
    let typed = match (of, unit) {
        (Type::State, _) => format!("declaredType=\"{STATE}\" "),
        (_, "") => String::new(),
        (_, unit) => format!("unit=\"{unit}\" "),
    };
    let description = escaped(description);
    format!(
        "    <{kind} name=\"{name}\" valueReference=\"{number}\" causality=\"{causality}\" variability=\"{variability}\" \
         {initial}{start}{typed}description=\"{description}\"/>\n"
    )
}

fn varies(of: Type) -> &'static str {
    match of {
        Type::Float64(_) => "continuous",
        _ => "discrete",
    }
}

/// The description as XML.
pub(super) fn xml(described: &Described) -> String {
    let Described {
        name,
        description,
        station,
        token,
        tick_hz,
        duration_s,
        ..
    } = described;
    let [name, station] = [name, station].map(|text| escaped(text));
    let description = escaped(&format!(
        "Station '{station}' of the scenario {name}. {description}"
    ));
    let version = crate::VERSION;
    let step_s = 1.0 / f64::from(*tick_hz);
    let mut out = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token}" description="{description}" generationTool="Boresight {version}" variableNamingConvention="structured">
  <CoSimulation modelIdentifier="{IDENTIFIER}" needsExecutionTool="false" canBeInstantiatedOnlyOncePerProcess="false" canGetAndSetFMUState="false" canSerializeFMUState="false" canHandleVariableCommunicationStepSize="true" fixedInternalStepSize="{step_s}" hasEventMode="false"/>
  <UnitDefinitions>
    <Unit name="rad"><BaseUnit rad="1"/></Unit>
    <Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="s"><BaseUnit s="1"/></Unit>
    <Unit name="W"><BaseUnit kg="1" m="2" s="-3"/></Unit>
    <Unit name="J"><BaseUnit kg="1" m="2" s="-2"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <EnumerationType name="{STATE}">
"#
    );
    for (at, state) in STATES.iter().enumerate() {
        let (state, number) = (state.name(), at + 1);
        let _ = writeln!(out, "      <Item name=\"{state}\" value=\"{number}\"/>");
    }
    let _ = write!(
        out,
        r#"    </EnumerationType>
  </TypeDefinitions>
  <LogCategories>
    <Category name="logStatusError" description="Why a call was refused or failed"/>
  </LogCategories>
  <DefaultExperiment startTime="0" stopTime="{duration_s}" stepSize="{step_s}"/>
  <ModelVariables>
    <Float64 name="time" valueReference="{TIME}" causality="independent" variability="continuous" unit="s" description="Simulated time"/>
"#
    );
    for variable in VARIABLES {
        out.push_str(&element(variable, described));
    }
    out.push_str("  </ModelVariables>\n  <ModelStructure>\n");
    let outputs = || {
        VARIABLES
            .iter()
            .filter(|own| own.causality == Causality::Output)
    };
    for output in outputs() {
        let _ = writeln!(out, "    <Output valueReference=\"{}\"/>", output.reference);
    }
    for output in outputs() {
        let _ = writeln!(
            out,
            "    <InitialUnknown valueReference=\"{}\"/>",
            output.reference
        );
    }
    out.push_str("  </ModelStructure>\n</fmiModelDescription>\n");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_break_out_of_its_attribute() {
        let described = Described {
            name: "a\"<b>&",
            description: "two\nlines",
            station: "north",
            token: "{1}",
            seed: 7,
            may_fire: true,
            tick_hz: 960,
            duration_s: 25.0,
        };
        let xml = xml(&described);
        assert!(xml.contains("modelName=\"a&quot;&lt;b&gt;&amp;\""), "{xml}");
        assert!(xml.contains("two lines"));
        assert!(xml.contains("name=\"seed\" valueReference=\"1\" causality=\"parameter\" variability=\"fixed\" initial=\"exact\" start=\"7\""));
        assert!(xml.contains("name=\"fire_authority\" valueReference=\"15\" causality=\"input\" variability=\"discrete\" start=\"true\""));
        for own in VARIABLES {
            assert_eq!(xml.matches(&format!("name=\"{}\"", own.name)).count(), 1);
        }
    }
}
