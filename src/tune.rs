//! `boresight tune`: the loops of a scenario's mount measured, and the gains that follow.

use crate::app::{self, RunError};
use crate::components::capture::Tier;
use crate::components::control::Controller;
use crate::components::run::SimClock;
use crate::models::control::lqg::{LqgMemory, LqgPointing, LqgWeights};
use crate::models::control::paper::PaperLaw;
use crate::models::control::pointing::PointingLaw;
use crate::models::control::tuned::MirrorRemainder;
use crate::models::control::tuning::{
    CameraTiming, Derived, LoopMeasurement, MountAxis, MountPlant, derive, measure_mirror,
    measure_paper_loop, measure_pointing_loop, measure_position_loop, measure_rate_loop,
};
use crate::models::maths::frequency::{Margin, Response, StepFigures, db, unwrapped_phase_rad};
use crate::models::optics::camera::Pinhole;
use crate::models::tracking::estimation::LosFilterParams;
use crate::plugins::control::controller;
use crate::plugins::mount::{gimbal_params, mirror_params};
use crate::plugins::track::tracker_params;
use crate::report::{Across, Chart, Escaped, STYLE, Scale, Series};
use crate::scenario::{ControllerPreset, Exposure, Loaded};
use glam::DVec3;
use serde::Serialize;
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};

/// An axis, as the command line names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisName {
    /// Outer axis.
    Azimuth,
    /// Inner axis.
    Elevation,
}

impl From<AxisName> for MountAxis {
    fn from(name: AxisName) -> Self {
        match name {
            AxisName::Azimuth => MountAxis::Azimuth,
            AxisName::Elevation => MountAxis::Elevation,
        }
    }
}

/// Exposure that an automatic one is counted as [s].
const AUTO_EXPOSURE_S: f64 = 1e-3;

/// What a tuning found.
#[derive(Clone, Debug)]
pub struct Tuning {
    scenario: String,
    axis: AxisName,
    preset: ControllerPreset,
    latency_s: f64,
    loops: Vec<LoopMeasurement>,
    in_use: Option<PointingLaw>,
    derived: Derived,
}

/// A loop in tune.json.
#[derive(Serialize)]
struct LoopJson<'a> {
    name: &'a str,
    unit: &'a str,
    amplitude: f64,
    gain_margin_db: Option<Margin>,
    phase_margin_deg: Option<Margin>,
    peak_sensitivity: f64,
    closed_bandwidth_hz: Option<f64>,
    step: Option<StepFigures>,
    frequency_hz: Vec<f64>,
    open_db: Vec<f64>,
    open_deg: Vec<f64>,
    closed_db: Vec<f64>,
    closed_deg: Vec<f64>,
}

/// tune.json.
#[derive(Serialize)]
struct TuneJson<'a> {
    scenario: &'a str,
    version: &'static str,
    axis: AxisName,
    preset: ControllerPreset,
    latency_s: f64,
    loops: Vec<LoopJson<'a>>,
    in_use: Option<[(&'static str, f64); 4]>,
    derived: [(&'static str, f64); 4],
    limited_by: &'static str,
}

fn decibels(responses: &[Response]) -> Vec<f64> {
    responses.iter().map(|r| db(r.value.norm())).collect()
}

fn degrees(responses: &[Response]) -> Vec<f64> {
    let phases = unwrapped_phase_rad(responses);
    phases.into_iter().map(f64::to_degrees).collect()
}

/// The gains of a law with their names.
fn gains(law: &PointingLaw) -> [(&'static str, f64); 4] {
    let [gain_per_s, lead_s, offset, rate_s] = match law {
        PointingLaw::Tuned(law) => {
            let MirrorRemainder { offset, rate_s } = law.mirror_left;
            [law.gimbal_gain_per_s, law.lead_s, offset, rate_s]
        }
        // The regulator has no lead; its mirror rows are gains of another kind.
        PointingLaw::Lqg(law, _) => {
            let [az, el] = law.gimbal_gains_per_s();
            [az.min(el), 0.0, f64::NAN, f64::NAN]
        }
    };
    [
        ("gimbal gain [1/s]", gain_per_s),
        ("lead [s]", lead_s),
        ("mirror offset left", offset),
        ("mirror rate left [s]", rate_s),
    ]
}

impl Tuning {
    /// Measures the loops of a scenario's mount along one axis.
    pub fn measure(loaded: &Loaded, axis_name: AxisName) -> Result<Self, RunError> {
        let scenario = &loaded.scenario;
        let file = loaded.path.display().to_string();
        let value = |what, why: String| RunError::Value {
            file: file.clone(),
            what,
            why,
        };
        let clock = SimClock {
            tick: 0,
            tick_hz: scenario.tick_hz,
        };
        let plant = MountPlant {
            gimbal: gimbal_params(&scenario.station.mount, clock.dt_s()),
            mirror: mirror_params(&scenario.station.mount),
            dt_s: clock.dt_s(),
        };
        plant
            .gimbal
            .validate()
            .map_err(|error| value("station.mount", error.to_string()))?;
        let cameras = scenario.station.cameras.resolved();
        let sigma_px = tracker_params(scenario, DVec3::ZERO).centre_sigma_px;
        let timing = |tier: Tier| {
            let camera = &cameras[tier as usize];
            let hfov_rad = camera.hfov_deg.to_radians();
            let pinhole = Pinhole::from_hfov(camera.width_px, camera.height_px, hfov_rad)
                .map_err(|error| value("station.cameras", error.to_string()))?;
            let exposure_s = match camera.exposure_s {
                Exposure::Seconds(exposure_s) => exposure_s,
                Exposure::Auto(_) => AUTO_EXPOSURE_S,
            };
            let latency_s =
                0.5 * exposure_s + camera.readout_latency_s + camera.inference_latency_s;
            Ok::<_, RunError>(CameraTiming {
                period_ticks: u64::from(scenario.tick_hz / camera.rate_hz),
                latency_ticks: clock.ticks_of(latency_s),
                sigma_rad: sigma_px * pinhole.ifov_rad(),
            })
        };
        let precise = timing(Tier::Precise)?;

        let refused = |error: crate::models::control::tuning::TuningError| {
            value("station.mount", error.to_string())
        };
        let axis = axis_name.into();
        let derived = derive(&plant).map_err(refused)?;
        let filter = LosFilterParams::default();
        let lqg = LqgPointing::new(
            &plant.gimbal,
            &plant.mirror,
            filter.accel_tau_s,
            &LqgWeights::default(),
            plant.dt_s,
        )
        .map_err(|error| value("station.mount", error.to_string()))?;
        let mut loops = vec![
            measure_rate_loop(&plant, axis),
            measure_position_loop(&plant, axis, derived.law.gimbal_gain_per_s),
            measure_mirror(&plant).map_err(refused)?,
        ];
        for law in [
            PointingLaw::Tuned(derived.law),
            PointingLaw::Lqg(lqg, LqgMemory::default()),
        ] {
            let measured = measure_pointing_loop(&plant, axis, precise, filter, law);
            loops.push(measured.map_err(refused)?);
        }
        let controller = controller(loaded, &plant.gimbal, &plant.mirror, plant.dt_s)?;
        let in_use = match controller {
            Controller::Pointing(pointing) => Some(pointing.law),
            Controller::Paper(paper) => {
                let law: PaperLaw = paper.coarse_law;
                loops.push(measure_paper_loop(&plant, axis, timing(Tier::Coarse)?, law));
                None
            }
        };
        Ok(Self {
            scenario: scenario.name.clone(),
            axis: axis_name,
            preset: scenario.controller.preset,
            latency_s: precise.latency_ticks as f64 * plant.dt_s,
            loops,
            in_use,
            derived,
        })
    }

    /// Margins and gains as text.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<24} {:>15} {:>16} {:>16} {:>10} {:>6} {:>9} {:>6} {:>9}\n",
            "loop",
            "amplitude",
            "gain margin",
            "phase margin",
            "-3 dB",
            "Ms",
            "rise",
            "over",
            "settle",
        );
        for cells in self.loops.iter().map(cells) {
            let [name, amplitude, gain, phase, band, peak, rise, over, settle] = cells;
            text += &format!(
                "{name:<24} {amplitude:>15} {gain:>16} {phase:>16} {band:>10} {peak:>6} \
                 {rise:>9} {over:>6} {settle:>9}\n"
            );
        }
        text += &format!("\n{:<24} {:>12} {:>12}\n", "gain", "in use", "derived");
        for (name, in_use, derived) in self.gain_rows() {
            text += &format!("{name:<24} {in_use:>12} {derived:>12}\n");
        }
        text + &format!("gimbal gain limited by: {}\n", self.derived.limit)
    }

    fn gain_rows(&self) -> Vec<(&'static str, String, String)> {
        let show = |x: f64| {
            if x.is_nan() {
                "-".into()
            } else if x.abs() < 0.1 {
                format!("{x:.3e}")
            } else {
                format!("{x:.3}")
            }
        };
        let derived = gains(&PointingLaw::Tuned(self.derived.law));
        let in_use = self.in_use.as_ref().map(gains);
        (0..derived.len())
            .map(|k| {
                let (name, value) = derived[k];
                let used = in_use.map_or("-".into(), |gains| show(gains[k].1));
                (name, used, show(value))
            })
            .collect()
    }

    /// Writes tune.json and tune.html to a folder; returns the page's path.
    pub fn write(&self, out: &Path) -> Result<PathBuf, RunError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| RunError::Output { path, source }
        };
        std::fs::create_dir_all(out).map_err(failed(out))?;
        let json = out.join("tune.json");
        std::fs::write(&json, self.json()?).map_err(failed(&json))?;
        let page = out.join("tune.html");
        let mut html = String::new();
        self.html(&mut html)
            .map_err(std::io::Error::other)
            .and_then(|()| std::fs::write(&page, html))
            .map_err(failed(&page))?;
        Ok(page)
    }

    fn json(&self) -> Result<String, serde_json::Error> {
        let loops = self.loops.iter().map(|measured| LoopJson {
            name: &measured.name,
            unit: measured.unit,
            amplitude: measured.amplitude,
            gain_margin_db: measured.margins.gain_db,
            phase_margin_deg: measured.margins.phase_deg,
            peak_sensitivity: measured.margins.peak_sensitivity,
            closed_bandwidth_hz: measured.bandwidth_hz,
            step: measured.step_figures,
            frequency_hz: measured.open.iter().map(|r| r.frequency_hz).collect(),
            open_db: decibels(&measured.open),
            open_deg: degrees(&measured.open),
            closed_db: decibels(&measured.closed),
            closed_deg: degrees(&measured.closed),
        });
        let mut text = serde_json::to_string_pretty(&TuneJson {
            scenario: &self.scenario,
            version: app::VERSION,
            axis: self.axis,
            preset: self.preset,
            latency_s: self.latency_s,
            loops: loops.collect(),
            in_use: self.in_use.as_ref().map(gains),
            derived: gains(&PointingLaw::Tuned(self.derived.law)),
            limited_by: self.derived.limit,
        })?;
        text.push('\n');
        Ok(text)
    }

    fn html(&self, out: &mut String) -> fmt::Result {
        let title = format!("Loops of {}", self.scenario);
        let axis = match self.axis {
            AxisName::Azimuth => "azimuth",
            AxisName::Elevation => "elevation",
        };
        writeln!(
            out,
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
             <title>{title}</title>\n<style>{STYLE}.name{{white-space:nowrap}}</style>\n</head>\n<body>\n<header>\n\
             <h1>{title}</h1>\n<p class=\"meta\"><span>Axis <code>{axis}</code></span>\
             <span>Latency <code>{:.1} ms</code></span><span>Version <code>{}</code></span></p>\n\
             </header>\n<h2>Margins</h2>\n<div class=\"scroll\"><table>\n<tr><th>Loop</th>\
             <th class=\"n\">amplitude</th><th class=\"n\">gain margin</th>\
             <th class=\"n\">phase margin</th><th class=\"n\">−3 dB, closed</th>\
             <th class=\"n\">peak sensitivity</th><th class=\"n\">rise</th>\
             <th class=\"n\">overshoot</th><th class=\"n\">settling</th></tr>",
            1e3 * self.latency_s,
            app::VERSION,
            title = Escaped(&title),
        )?;
        for [name, rest @ ..] in self.loops.iter().map(cells) {
            write!(out, "<tr><td class=\"name\">{}</td>", Escaped(&name))?;
            for cell in rest {
                write!(out, "<td class=\"n\">{}</td>", Escaped(&cell))?;
            }
            out.push_str("</tr>\n");
        }
        out.push_str(
            "</table></div>\n<p class=\"note\">Open loops follow from the closed ones, \
             L = T/(1 − T). Rate and position loop are swept while the axis turns steadily, so that \
             friction does not reverse; the pointing loops at rest.</p>\n<h2>Gains</h2>\n\
             <div class=\"scroll\"><table>\n<tr><th>Gain</th><th class=\"n\">in use</th>\
             <th class=\"n\">derived</th></tr>\n",
        );
        for (name, in_use, derived) in self.gain_rows() {
            writeln!(
                out,
                "<tr><td>{name}</td><td class=\"n\">{in_use}</td>\
                 <td class=\"n\">{derived}</td></tr>"
            )?;
        }
        writeln!(
            out,
            "</table></div>\n<p class=\"note\">The gimbal's gain is limited by: {}.</p>",
            self.derived.limit
        )?;
        for measured in &self.loops {
            loop_charts(out, measured)?;
        }
        out.push_str("</body>\n</html>\n");
        Ok(())
    }
}

/// A loop's row: name, amplitude, gain and phase margin, bandwidth, peak sensitivity, rise,
/// overshoot, settling.
fn cells(measured: &LoopMeasurement) -> [String; 9] {
    let margin = |margin: Option<Margin>, unit: &str| {
        margin.map_or("-".into(), |m| {
            format!("{:.1} {unit} {:.1} Hz", m.value, m.frequency_hz)
        })
    };
    let figure =
        |f: fn(&StepFigures) -> String| (measured.step_figures.as_ref()).map_or("-".into(), f);
    [
        measured.name.clone(),
        format!("{:.2e} {}", measured.amplitude, measured.unit),
        margin(measured.margins.gain_db, "dB"),
        margin(measured.margins.phase_deg, "°"),
        (measured.bandwidth_hz).map_or("-".into(), |hz| format!("{hz:.2} Hz")),
        format!("{:.2}", measured.margins.peak_sensitivity),
        figure(|s| format!("{:.1} ms", 1e3 * s.rise_s)),
        figure(|s| format!("{:.0} %", 1e2 * s.overshoot)),
        figure(|s| {
            s.settling_s
                .map_or("-".into(), |t| format!("{:.1} ms", 1e3 * t))
        }),
    ]
}

/// Magnitude, phase and step of one loop.
fn loop_charts(out: &mut String, measured: &LoopMeasurement) -> fmt::Result {
    writeln!(
        out,
        "<h2>{}</h2>\n<div class=\"charts\">",
        Escaped(&measured.name)
    )?;
    let over = |values: Vec<f64>| -> Series {
        let at = measured.open.iter().map(|r| r.frequency_hz);
        at.zip(values).collect()
    };
    let (open_db, closed_db) = (
        over(decibels(&measured.open)),
        over(decibels(&measured.closed)),
    );
    let (open_deg, closed_deg) = (
        over(degrees(&measured.open)),
        over(degrees(&measured.closed)),
    );
    if let (Some(first), Some(last)) = (open_db.first(), open_db.last()) {
        let across = Across::frequency(first.0, last.0);
        let bode = [
            ("Magnitude", "dB", &open_db, &closed_db, ("unit gain", 0.0)),
            (
                "Phase",
                "°",
                &open_deg,
                &closed_deg,
                ("half a turn", -180.0),
            ),
        ];
        for (title, unit, open, closed, limit) in bode {
            Chart {
                title,
                unit,
                scale: Scale::Linear,
                series: &[("open loop", open), ("closed loop", closed)],
                limit: Some(limit),
            }
            .html(out, &across)?;
        }
    }
    let step: Series = (measured.step.iter().enumerate())
        .map(|(k, y)| ((k + 1) as f64 * measured.dt_s, *y))
        .collect();
    let end_s = step.last().map_or(0.0, |last| last.0);
    Chart {
        title: "Step response",
        unit: "share",
        scale: Scale::Linear,
        series: &[("", &step)],
        limit: Some(("step", 1.0)),
    }
    .html(out, &Across::time("time [s]", end_s))?;
    out.push_str("</div>\n");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    #[test]
    fn tunes_the_shipped_scenario_and_writes_both_files() {
        let file = Path::new("scenarios/urban_intercept.toml");
        let loaded = Scenario::load(file, &[]).unwrap();
        let tuning = Tuning::measure(&loaded, AxisName::Elevation).unwrap();
        // The gains in use are the derived ones.
        let Some(PointingLaw::Tuned(in_use)) = tuning.in_use else {
            panic!("{:?}", tuning.in_use);
        };
        let derived = tuning.derived.law.gimbal_gain_per_s;
        assert!((in_use.gimbal_gain_per_s / derived - 1.0).abs() < 0.03);
        let folder = tempfile::tempdir().unwrap();
        let page = tuning.write(folder.path()).unwrap();
        let html = std::fs::read_to_string(page).unwrap();
        assert_eq!(html.matches("<svg").count(), 3 * tuning.loops.len());
        assert!(!html.contains("NaN") && !html.contains("http"));
        let json = std::fs::read_to_string(folder.path().join("tune.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let phase = &json["loops"][1]["phase_margin_deg"]["value"];
        assert!(phase.as_f64().unwrap() > 45.0);
    }
}
