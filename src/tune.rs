//! `boresight tune`: the loops of a scenario's mount measured, and the gains that follow.

use crate::components::capture::Tier;
use crate::components::control::Controller;
use crate::components::detect::Reading;
use crate::components::run::SimClock;
use crate::models::control::paper::PaperLaw;
use crate::models::control::pointing::PointingLaw;
use crate::models::control::tuning::{
    CameraTiming, Derived, LoopMeasurement, MountAxis, MountPlant, TuningError, derive,
    measure_mirror, measure_paper_loop, measure_pointing_loop, measure_position_loop,
    measure_rate_loop,
};
use crate::models::maths::frequency::{Margin, Response, StepFigures, db, unwrapped_phase_rad};
use crate::models::optics::camera::{CameraError, Pinhole};
use crate::models::tracking::estimation::LosFilterParams;
use crate::models::tracking::evidence::NEUTRAL_SCORE;
use crate::output::{self, OutputError, columns};
use crate::parameters::control::{controller, laws};
use crate::parameters::mount::{gimbal_params, mirror_params};
use crate::parameters::track::tracker_params;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, note, page};
use crate::scenario::{self, Exposure, InputError, Loaded, Scenario};
use glam::DVec3;
use maud::{Markup, html};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Why a mount cannot be tuned.
#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    /// The scenario's mount, cameras or controller.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// The figures cannot be encoded.
    #[error("tune.json: cannot be encoded: {0}; this is a fault of the program: please report it")]
    Json(#[from] serde_json::Error),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

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
    preset: String,
    latency_s: f64,
    loops: Vec<LoopMeasurement>,
    in_use: Option<Box<dyn PointingLaw>>,
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
    preset: &'a str,
    latency_s: f64,
    loops: Vec<LoopJson<'a>>,
    in_use: Option<Vec<(&'static str, f64)>>,
    derived: Vec<(&'static str, f64)>,
    limited_by: &'static str,
}

fn decibels(responses: &[Response]) -> Vec<f64> {
    responses.iter().map(|r| db(r.value.norm())).collect()
}

fn degrees(responses: &[Response]) -> Vec<f64> {
    let phases = unwrapped_phase_rad(responses);
    phases.into_iter().map(f64::to_degrees).collect()
}

impl Tuning {
    /// Measures the loops of a scenario's mount along one axis.
    pub fn measure(loaded: &Loaded, axis_name: AxisName) -> Result<Self, TuneError> {
        let scenario = &loaded.scenario;
        let clock = SimClock {
            tick: 0,
            tick_hz: scenario.tick_hz,
        };
        let station = first_station(scenario);
        let plant = MountPlant {
            gimbal: gimbal_params(&station.mount, clock.dt_s()),
            mirror: mirror_params(&station.mount),
            gyro: station.mount.gyro.params(),
            dt_s: clock.dt_s(),
        };
        let refuse_mount = |error: String| loaded.refuse("station.mount", error);
        (plant.gimbal.validate()).map_err(|error| refuse_mount(error.to_string()))?;
        let timing = |tier| {
            timing(scenario, &clock, tier).map_err(|error| loaded.refuse("station.cameras", error))
        };
        let precise = timing(Tier::Precise)?;
        let refused = |error: TuningError| refuse_mount(error.to_string());
        let axis = axis_name.into();
        let derived = derive(&plant).map_err(refused)?;
        let filter = LosFilterParams::default();
        let mut loops = vec![
            measure_rate_loop(&plant, axis),
            measure_position_loop(&plant, axis, derived.law.gimbal_gain_per_s),
            measure_mirror(&plant).map_err(refused)?,
        ];
        let laws = laws();
        for name in laws.names() {
            if let Some(law) = laws.make(name, &plant) {
                let law = law.map_err(|error| refuse_mount(error.to_string()))?;
                let measured = measure_pointing_loop(&plant, axis, precise, filter, (name, &*law));
                loops.push(measured.map_err(refused)?);
            }
        }
        let controller = controller(loaded, &laws, "station", &plant)?;
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
            preset: scenario.controller.preset.clone(),
            latency_s: precise.latency_ticks as f64 * plant.dt_s,
            loops,
            in_use,
            derived,
        })
    }

    /// Margins and gains as text.
    pub fn table(&self) -> String {
        const HEAD: [&str; 9] = [
            "loop",
            "amplitude",
            "gain margin",
            "phase margin",
            "-3 dB",
            "Ms",
            "rise",
            "over",
            "settle",
        ];
        let loops: Vec<Vec<String>> = self.loops.iter().map(|of| cells(of).to_vec()).collect();
        let gains = self.gain_rows().into_iter();
        let gains: Vec<Vec<String>> = gains
            .map(|(name, in_use, derived)| vec![name.to_owned(), in_use, derived])
            .collect();
        let text =
            columns(&HEAD, &loops, 1) + "\n" + &columns(&["gain", "in use", "derived"], &gains, 1);
        text + &format!("gimbal gain limited by: {}\n", self.derived.limit)
    }

    fn gain_rows(&self) -> Vec<(&'static str, String, String)> {
        let show = |x: f64| {
            if x.abs() < 0.1 {
                format!("{x:.3e}")
            } else {
                format!("{x:.3}")
            }
        };
        let in_use = self
            .in_use
            .as_ref()
            .map_or_else(Vec::new, |law| law.gains());
        (self.derived.law.gains().into_iter())
            .map(|(name, value)| {
                let used = in_use.iter().find(|(other, _)| *other == name);
                let used = used.map_or("-".into(), |(_, value)| show(*value));
                (name, used, show(value))
            })
            .collect()
    }

    /// Writes tune.json and tune.html to a folder; returns the page's path.
    pub fn write(&self, out: &Path) -> Result<PathBuf, TuneError> {
        output::create_dir(out)?;
        output::write(&out.join("tune.json"), self.json()?)?;
        let path = out.join("tune.html");
        output::write(&path, self.page())?;
        Ok(path)
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
            version: crate::VERSION,
            axis: self.axis,
            preset: &self.preset,
            latency_s: self.latency_s,
            loops: loops.collect(),
            in_use: self.in_use.as_ref().map(|law| law.gains()),
            derived: self.derived.law.gains(),
            limited_by: self.derived.limit,
        })?;
        text.push('\n');
        Ok(text)
    }

    fn page(&self) -> String {
        let title = format!("Loops of {}", self.scenario);
        let axis = match self.axis {
            AxisName::Azimuth => "azimuth",
            AxisName::Elevation => "elevation",
        };
        let latency = format!("{:.1} ms", 1e3 * self.latency_s);
        let head = Head {
            title: &title,
            heading: &title,
            facts: &[
                ("Axis", axis),
                ("Latency", &latency),
                ("Version", crate::VERSION),
            ],
            style: ".name{white-space:nowrap}",
        };
        let body = html! {
            h2 { "Margins" }
            (self.margin_table())
            (note(
                "Open loops follow from the closed ones, L = T/(1 − T). Rate and position loop are swept \
                 while the axis turns steadily, so that friction does not reverse; the pointing loops at \
                 rest.",
            ))
            h2 { "Gains" }
            (self.gain_table())
            p .note { "The gimbal's gain is limited by: " (self.derived.limit) "." }
            @for measured in &self.loops { (loop_charts(measured)) }
        };
        page(&head, &body)
    }

    fn margin_table(&self) -> Markup {
        const HEAD: [&str; 8] = [
            "amplitude",
            "gain margin",
            "phase margin",
            "−3 dB, closed",
            "peak sensitivity",
            "rise",
            "overshoot",
            "settling",
        ];
        html! {
            div .scroll {
                table {
                    tr {
                        th { "Loop" }
                        @for label in HEAD { th .n { (label) } }
                    }
                    @for [name, rest @ ..] in self.loops.iter().map(cells) {
                        tr {
                            td .name { (name) }
                            @for cell in rest { td .n { (cell) } }
                        }
                    }
                }
            }
        }
    }

    fn gain_table(&self) -> Markup {
        html! {
            div .scroll {
                table {
                    tr {
                        th { "Gain" }
                        th .n { "in use" }
                        th .n { "derived" }
                    }
                    @for (name, in_use, derived) in self.gain_rows() {
                        tr {
                            td { (name) }
                            td .n { (in_use) }
                            td .n { (derived) }
                        }
                    }
                }
            }
        }
    }
}

/// The station that is tuned.
fn first_station(scenario: &Scenario) -> &scenario::Station {
    scenario.stations.first().unwrap_or(&scenario.station)
}

/// The timing of a camera and the noise of its detections, for the loops.
fn timing(scenario: &Scenario, clock: &SimClock, tier: Tier) -> Result<CameraTiming, CameraError> {
    let cameras = &first_station(scenario).cameras;
    let camera = &cameras.resolved()[tier as usize];
    let hfov_rad = camera.hfov_deg.to_radians();
    let pinhole = Pinhole::from_hfov(camera.width_px, camera.height_px, hfov_rad)?;
    let exposure_s = match camera.exposure_s {
        Exposure::Seconds(exposure_s) => exposure_s,
        Exposure::Auto(_) => AUTO_EXPOSURE_S,
    };
    let latency_s = 0.5 * exposure_s + camera.readout_latency_s + camera.inference_latency_s;
    let detector = &scenario.detector;
    let reading = if detector.is_truth() {
        Reading::of_truth(detector.truth.noise_px)
    } else {
        Reading::of_network(0.0, 0.0, NEUTRAL_SCORE, None)
    };
    let sigma_px = tracker_params(
        scenario,
        &scenario.station.cameras.all(),
        DVec3::ZERO,
        &reading,
    )
    .centre_sigma_px;
    Ok(CameraTiming {
        period_ticks: u64::from(scenario.tick_hz / camera.rate_hz),
        latency_ticks: clock.ticks_of(latency_s),
        sigma_rad: sigma_px * pinhole.ifov_rad(),
    })
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
fn loop_charts(measured: &LoopMeasurement) -> Markup {
    html! {
        h2 { (measured.name) }
        div .charts {
            (bode(measured))
            (step_chart(measured))
        }
    }
}

fn bode(measured: &LoopMeasurement) -> Markup {
    let over = |values: Vec<f64>| -> Series {
        let at = measured.open.iter().map(|r| r.frequency_hz);
        at.zip(values).collect()
    };
    let [open_db, closed_db] = [&measured.open, &measured.closed].map(|r| over(decibels(r)));
    let [open_deg, closed_deg] = [&measured.open, &measured.closed].map(|r| over(degrees(r)));
    let (Some(first), Some(last)) = (open_db.first(), open_db.last()) else {
        return html! {};
    };
    let across = Across::frequency(first.0, last.0);
    let chart = |title, unit, open, closed, limit| {
        let chart = Chart {
            title,
            unit,
            scale: Scale::Linear,
            series: &[("open loop", open), ("closed loop", closed)],
            limit: Some(limit),
        };
        chart.figure(&across)
    };
    html! {
        (chart("Magnitude", "dB", &open_db, &closed_db, ("unit gain", 0.0)))
        (chart("Phase", "°", &open_deg, &closed_deg, ("half a turn", -180.0)))
    }
}

fn step_chart(measured: &LoopMeasurement) -> Markup {
    let step: Series = (measured.step.iter().enumerate())
        .map(|(k, y)| ((k + 1) as f64 * measured.dt_s, *y))
        .collect();
    let end_s = step.last().map_or(0.0, |last| last.0);
    let chart = Chart {
        title: "Step response",
        unit: "share",
        scale: Scale::Linear,
        series: &[("", &step)],
        limit: Some(("step", 1.0)),
    };
    chart.figure(&Across::from_zero("time [s]", end_s))
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
        let in_use = tuning.in_use.as_ref().unwrap().gains();
        let derived = tuning.derived.law.gains();
        assert_eq!(in_use[0].0, "gimbal gain [1/s]");
        assert!((in_use[0].1 / derived[0].1 - 1.0).abs() < 0.03);
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
