//! Calls about weather, time of day, recording, and what clients print.

use super::answers::{Answer, Fault};
use super::session::Session;
use crate::scenario::{OrderConfig, WeatherOrder};
use crate::serve::entrance::say;
use boresight_airsim::frames::{heading_deg, swapped};
use boresight_airsim::{Arguments, Value};

/// Characters of a message that are printed.
const MOST_CHARACTERS: usize = 200;

fn apply(session: &mut Session, method: &str) -> Result<(), Fault> {
    let weather = WeatherOrder {
        visibility_m: Some(session.sky.visibility_m()),
        ..WeatherOrder::default()
    };
    let order = OrderConfig {
        weather: Some(weather),
        ..OrderConfig::default()
    };
    session.give(method, order)
}

/// `simEnableWeather`.
pub(super) fn enable(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    session.sky.enabled = of.flag("enable")?;
    apply(session, of.method())?;
    Ok(Value::Nil.into())
}

/// `simSetWeatherParameter`.
pub(super) fn set(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let parameter = of.whole("param")?;
    let value = of.number("val")?;
    if !(0.0..=1.0).contains(&value) {
        return Err(of.wrong(format!("val is {value}: give 0 to 1")).into());
    }
    match parameter {
        0 => session.sky.rain = value,
        7 => session.sky.fog = value,
        8 => session.sky.enabled = value > 0.0,
        _ if value == 0.0 => return Ok(Value::Nil.into()),
        _ => {
            return Err(of
                .wrong(format!(
                    "parameter {parameter} is not offered: there are Fog, as visibility, and Rain, as what its drops take of it"
                ))
                .into());
        }
    }
    if session.sky.enabled || parameter == 8 {
        apply(session, of.method())?;
    }
    Ok(Value::Nil.into())
}

/// `simSetWind`.
pub(super) fn set_wind(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let wind = swapped(of.vector("wind")?);
    if wind.z != 0.0 {
        return Err(of
            .wrong("wind blows along the ground: give a z_val of 0")
            .into());
    }
    let weather = WeatherOrder {
        wind_speed_mps: Some(wind.length()),
        // Without wind it comes from where it came.
        wind_from_deg: (wind.length() > 0.0).then(|| heading_deg((-wind.x).atan2(-wind.y))),
        ..WeatherOrder::default()
    };
    let order = OrderConfig {
        weather: Some(weather),
        ..OrderConfig::default()
    };
    session.give(of.method(), order)?;
    Ok(Value::Nil.into())
}

/// `simSetTimeOfDay`.
pub(super) fn set_time(of: &mut Arguments) -> Result<Answer, Fault> {
    match of.flag("is_enabled")? {
        false => Ok(Value::Nil.into()),
        true => Err(of
            .wrong("the sun stands where it stood at the start: set time_utc in the scenario, or --set time_utc=...")
            .into()),
    }
}

/// `simPrintLogMessage`.
pub(super) fn print(of: &mut Arguments) -> Result<Answer, Fault> {
    let message = of.text("message")? + &of.maybe_text("message_param")?;
    let printable = message.chars().filter(|c| !c.is_control());
    let shown: String = printable.take(MOST_CHARACTERS).collect();
    say(format!("airsim: {shown}"));
    Ok(Value::Nil.into())
}

/// `startRecording`: the run is recorded whole, or not at all.
pub(super) fn record(session: &mut Session, of: &Arguments) -> Result<Answer, Fault> {
    if !session.held.records() {
        return Err(of
            .wrong("this run is not recorded: serve it with --out FOLDER")
            .into());
    }
    session.recording = true;
    Ok(Value::Nil.into())
}
