//! A detector of one's own: what stands out most from its surroundings.
//!
//! `source scripts/env.sh; cargo run --release --example own_detector`

use boresight::components::track::TrackingState;
use boresight::simulation::parts::{Detection, Detector, PartError, Question, Reading};
use boresight::simulation::{Event, Simulation, SimulationError, What};
use std::collections::VecDeque;

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

/// What happened in a second of `urban_intercept`, its UAV high before an even sky, and the state at its end.
pub fn run() -> Result<(Vec<Event>, TrackingState), SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=contrast")
        .set("engage.authorised=false")
        .set(
            "uavs.0.trajectory={ kind = 'straight', start_enu_m = [-350, 350, 250], \
             velocity_enu_mps = [5, 5, 0] }",
        )
        .detector("contrast", |_context| Ok(Box::new(Contrast::default())))
        .open()?;
    run.run_until(1.0)?;
    let state = run.view().stations().next().map(|first| first.state());
    Ok((
        run.events().to_vec(),
        state.unwrap_or(TrackingState::Search),
    ))
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for event in run()?.0 {
        if let What::State { to, reason, .. } = event.what {
            println!("{:.3} s: {}, {reason}", event.t_s, to.name());
        }
    }
    Ok(())
}
