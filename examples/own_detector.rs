//! A detector of one's own: what stands out most from its surroundings.
//!
//! `source scripts/env.sh; cargo run --release --example own_detector`

use boresight::app::{Options, build_with, step};
use boresight::components::detect::{Detector, Detectors, Question, Reading};
use boresight::components::mount::first_station;
use boresight::components::run::PartError;
use boresight::components::track::Tracker;
use boresight::models::optics::detection::Detection;
use boresight::scenario::Scenario;
use std::collections::VecDeque;
use std::error::Error;
use std::path::Path;

/// Boxes of 5 px about the spot of each picture that stands out most.
#[derive(Default)]
struct Contrast {
    classes: [String; 0],
    answers: VecDeque<Vec<Detection>>,
}

impl Detector for Contrast {
    fn classes(&self) -> &[String] {
        &self.classes
    }

    fn reading(&self) -> Reading {
        Reading::of_network(0.3, 0.15, 0.3, Some(256))
    }

    fn ask(&mut self, questions: Vec<Question>) {
        self.answers.extend(questions.iter().map(stands_out));
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        Ok(self.answers.pop_front().unwrap_or_default())
    }
}

/// The pixel that is brighter, or darker, than those 6 px away on all four sides, by most.
fn stands_out(question: &Question) -> Vec<Detection> {
    let Question { frame, look, .. } = question;
    let Some(rgb8) = &frame.rgb8 else {
        return Vec::new();
    };
    let green = |x: u32, y: u32| {
        let [column, row] = [x - frame.rect.offset_px[0], y - frame.rect.offset_px[1]];
        f64::from(rgb8[3 * (row * frame.rect.size_px[0] + column) as usize + 1])
    };
    let ([x0, y0], [w, h]) = (look.offset_px, look.size_px);
    let places = (y0 + 6..y0 + h - 6).flat_map(|y| (x0 + 6..x0 + w - 6).map(move |x| (x, y)));
    let contrast = |(x, y): &(u32, u32)| {
        let around = [(x - 6, *y), (x + 6, *y), (*x, y - 6), (*x, y + 6)];
        let over = around.map(|(x_to, y_to)| green(*x, *y) - green(x_to, y_to));
        let least = |sign: f64| over.iter().map(|by| sign * by).fold(255.0, f64::min);
        least(1.0).max(least(-1.0))
    };
    let best = places.max_by(|a, b| contrast(a).total_cmp(&contrast(b)));
    let found = best.filter(|at| contrast(at) > 10.0).map(|(x, y)| {
        let [x, y] = [x, y].map(|at| f64::from(at) + 0.5);
        Detection::new([x - 2.5, y - 2.5, x + 2.5, y + 2.5], 0.8, 0)
    });
    found.into_iter().collect()
}

/// The tracker after a second of `urban_intercept`, its UAV high before an even sky.
pub fn run() -> Result<Tracker, Box<dyn Error>> {
    let set = [
        "detector.kind=contrast",
        "engage.authorised=false",
        "uavs.0.trajectory={ kind = 'straight', start_enu_m = [-350, 350, 250], velocity_enu_mps = [5, 5, 0] }",
    ];
    let set = set.map(String::from);
    let loaded = Scenario::load(Path::new("scenarios/urban_intercept.toml"), &set)?;
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let mut app = build_with(&loaded, &options, |app| {
        let mut detectors = app.world_mut().resource_mut::<Detectors>();
        detectors.add("contrast", |_context| Ok(Box::new(Contrast::default())));
    })?;
    for _ in 0..loaded.scenario.tick_hz {
        step(app.world_mut())?;
    }
    let tracker: &Tracker = first_station(app.world()).ok_or("no station")?;
    Ok(tracker.clone())
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
    for change in run()?.changes {
        println!(
            "tick {}: {}, {}",
            change.tick,
            change.to.name(),
            change.reason
        );
    }
    Ok(())
}
