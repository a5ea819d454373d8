//! `boresight view`: a run in a window, or recordings played back in one.

use crate::app::{self, Options, RunError};
use crate::components::view::{Pacing, Playback, ScreenshotRequest, Session, SessionEnd};
use crate::output::{self, OutputError};
use crate::plugins::view::ViewPlugin;
use crate::recording::read::Recorded;
use crate::recording::timeline::Timeline;
use crate::report::ReportError;
use crate::report::summary::{self, Finished};
use crate::scenario::Loaded;
use crate::simulation::with_orders;
use bevy::prelude::*;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::mpsc::channel;
use std::time::Instant;

/// Why a window cannot be shown, or its session not be written.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The run cannot be built, or failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Summary or report cannot be written.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// No display to open a window on.
    #[error("no display: DISPLAY is not set; start it under a desktop, or with xvfb-run")]
    NoDisplay,
    /// A screenshot's name without a known ending.
    #[error("--screenshot: {}: its name does not say which kind of picture it is; end it in .jpg or .png", .0.display())]
    Screenshot(PathBuf),
    /// A recording without anything to play back.
    #[error("{}: has no states: its run was killed before the first; make the run again", .0.display())]
    Nothing(PathBuf),
    /// The operator's orders cannot be written as TOML.
    #[error(
        "--save-orders: the scenario cannot be written as TOML: {0}; this is a fault of the program: please report it"
    )]
    Orders(#[from] toml::ser::Error),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// What a window session leaves besides its recording.
#[derive(Clone, Debug, Default)]
pub struct Keep {
    /// A picture of the window after so many simulated seconds, and then its end.
    pub screenshot: Option<(PathBuf, f64)>,
    /// The scenario with the operator's orders: run again, it repeats the session.
    pub orders: Option<PathBuf>,
}

/// Whether there is a display that a window can be opened on.
fn display() -> Result<(), ViewError> {
    let named = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux") && !named("DISPLAY") {
        Err(ViewError::NoDisplay)
    } else {
        Ok(())
    }
}

/// Whether a picture of the window can be written to that file.
fn check_screenshot(file: &Path) -> Result<(), ViewError> {
    let extension = file.extension().and_then(|extension| extension.to_str());
    if extension.is_some_and(|extension| matches!(extension, "jpg" | "jpeg" | "png")) {
        return Ok(());
    }
    Err(ViewError::Screenshot(file.to_owned()))
}

/// Runs a scenario in a window until that is closed; what the session left is written as in a run
/// without a window.
pub fn view(
    loaded: &Loaded,
    options: &Options,
    keep: &Keep,
) -> Result<Option<Finished>, ViewError> {
    let (sender, receiver) = channel();
    let (in_end_loaded, in_end_options, orders) =
        (loaded.clone(), options.clone(), keep.orders.clone());
    let ended: SessionEnd = Box::new(move |world, result, elapsed| {
        let (loaded, options) = (&in_end_loaded, &in_end_options);
        let finished = result
            .map_err(|error| ViewError::Run(error.into()))
            .and_then(|()| {
                if let Some(file) = &orders {
                    output::write(file, with_orders(world, loaded, options)?)?;
                }
                Ok(summary::conclude(world, loaded, options, elapsed)?)
            });
        // The receiver waits below for the event loop to return.
        let _ = sender.send(finished);
    });
    let mut session = session(keep.screenshot.as_ref(), ended)?;
    if let (Some(shot), Some((_, at_s))) = (&mut session.screenshot, &keep.screenshot) {
        shot.at_s = Some(*at_s);
    }
    let mut app = app::prepare_with(loaded, options, |app| {
        app.insert_resource(session).add_plugins(ViewPlugin);
    })?;
    app.run();
    receiver.try_recv().ok().transpose()
}

/// Plays recordings back in a window until that is closed: the first fills the scene, a second is marked in it.
pub fn play(
    recordings: Vec<Recorded>,
    screenshot: Option<(PathBuf, f64)>,
) -> Result<(), ViewError> {
    let Some(first) = recordings.first() else {
        return Ok(());
    };
    // Nothing detects: what was found has been recorded.
    let scene = first
        .scenario(&["detector.kind=truth".into()])
        .map_err(RunError::from)?;
    let timelines: Vec<Timeline> = recordings.iter().map(Timeline::of).collect();
    if let Some(empty) = timelines.iter().find(|timeline| timeline.last_tick == 0) {
        return Err(ViewError::Nothing(empty.path.clone()));
    }
    // They are large, and all that is shown of them has been taken over.
    drop(recordings);
    let (sender, receiver) = channel();
    let ended: SessionEnd = Box::new(move |_, result, _| {
        // As above.
        let _ = sender.send(result);
    });
    let session = session(screenshot.as_ref(), ended)?;
    let mut playback = Playback::new(timelines);
    let mut pacing = Pacing::default();
    if let Some((_, at_s)) = screenshot {
        playback.t_s = at_s.clamp(0.0, playback.end_s());
        pacing.paused = true;
    }
    let options = Options {
        capture: true,
        window: true,
        log: true,
        ..Options::default()
    };
    let mut app = app::prepare_with(&scene, &options, |app| {
        app.insert_resource(session)
            .insert_resource(playback)
            .insert_resource(pacing)
            .add_plugins(ViewPlugin);
    })?;
    app.run();
    match receiver.try_recv() {
        Ok(Err(error)) => Err(RunError::from(error).into()),
        Ok(Ok(())) | Err(_) => Ok(()),
    }
}

/// A session of a window that can be opened.
fn session(screenshot: Option<&(PathBuf, f64)>, ended: SessionEnd) -> Result<Session, ViewError> {
    if let Some((file, _)) = screenshot {
        check_screenshot(file)?;
    }
    display()?;
    let now = Instant::now();
    Ok(Session {
        started: now,
        last: now,
        lately: VecDeque::new(),
        waiting: Some(0),
        screenshot: screenshot.map(|(file, _)| ScreenshotRequest {
            file: file.clone(),
            at_s: None,
            drawn: 0,
        }),
        ended: Some(ended),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::mount::Stations;
    use crate::components::mount::first_station;
    use crate::components::operator::Order;
    use crate::components::operator::{Command, Designation, Operator};
    use crate::scenario::{GainsOrder, Scenario, WeatherOrder};

    #[test]
    fn a_session_is_kept_as_a_scenario() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let path = root.join("scenarios/crossing_pair.toml");
        let set = ["detector.kind=truth", "duration_s=2"].map(String::from);
        let loaded = Scenario::load(&path, &set).unwrap();
        let options = Options {
            seed: Some(7),
            ..Options::default()
        };
        let mut app = app::build(&loaded, &options).unwrap();
        let orders = [
            (48, Designation::Track(3)),
            (960, Designation::Uav(1)),
            (961, Designation::Release),
        ]
        .map(|(tick, target)| (tick, Command::Target(target)));
        let gains = GainsOrder {
            gimbal_per_s: Some(0.1 + 0.2),
            ..GainsOrder::default()
        };
        let weather = WeatherOrder {
            wind_from_deg: Some(33.3),
            visibility_m: Some(1e4 / 3.0),
            ..WeatherOrder::default()
        };
        let others = [
            (970, Command::Fire(false)),
            (971, Command::Slew([312.4, 0.7 / 3.0])),
            (972, Command::Gains(gains)),
            (972, Command::Law("lqg".into())),
            (1000, Command::Weather(weather)),
        ];
        let orders: Vec<Order> = (orders.into_iter().chain(others))
            .map(|(tick, command)| Order { tick, command })
            .collect();
        let world = app.world_mut();
        // Given out of order, as a script and a window may.
        for order in [1, 0].map(|i| &orders[i]).into_iter().chain(&orders[2..]) {
            let mut operators = world.query::<&mut Operator>();
            operators.single_mut(world).unwrap().give(order.clone());
        }
        let text = with_orders(world, &loaded, &options).unwrap();
        let kept = Loaded::parse(text, "kept.toml".into(), Vec::new()).unwrap();
        assert_eq!(kept.scenario.seed, 7);
        assert_eq!(kept.scenario.duration_s, 2.0);
        let again = app::build(&kept, &Options::default()).unwrap();
        let kept = first_station::<Operator>(again.world()).unwrap();
        assert_eq!(kept.orders, orders);
    }

    #[test]
    fn an_order_to_one_of_two_stations_is_kept_as_its_own() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let path = root.join("scenarios/crossing_pair.toml");
        let set = [
            "detector.kind=truth",
            "duration_s=2",
            "stations=[{ name = 'west' }, { name = 'east', position_enu_m = [150, 40, 62] }]",
        ];
        let loaded = Scenario::load(&path, &set.map(String::from)).unwrap();
        let options = Options::default();
        let mut app = app::build(&loaded, &options).unwrap();
        let world = app.world_mut();
        let orders = |world: &World| -> Vec<Vec<Order>> {
            let stations = &world.resource::<Stations>().0;
            let of = |station: &Entity| world.get::<Operator>(*station).unwrap().orders.clone();
            stations.iter().map(of).collect()
        };
        let order = Order {
            tick: 960,
            command: Command::Target(Designation::Uav(1)),
        };
        let east = world.resource::<Stations>().0[1];
        world.get_mut::<Operator>(east).unwrap().give(order.clone());
        assert_eq!(orders(world), [vec![], vec![order.clone()]]);
        let text = with_orders(world, &loaded, &options).unwrap();
        let kept = Loaded::parse(text, "kept.toml".into(), Vec::new()).unwrap();
        let again = app::build(&kept, &options).unwrap();
        assert_eq!(orders(again.world()), [vec![], vec![order]]);
    }

    #[test]
    fn a_screenshot_is_a_jpeg_or_png() {
        assert!(check_screenshot(Path::new("docs/window.jpg")).is_ok());
        assert!(check_screenshot(Path::new("docs/window.png")).is_ok());
        let refused = check_screenshot(Path::new("docs/window.gif"));
        assert!(refused.is_err_and(|error| error.to_string().contains("window.gif")));
    }
}
