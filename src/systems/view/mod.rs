//! The window: it looks, sets the pace and passes on what the operator orders.
//!
//! A window frame first draws, then runs ticks, or moves through what was recorded. Drawing first lets the frame's Bevy main schedule
//! be the one that meets the fresh input; the sensor frames inside the ticks, which run that
//! schedule too, find none left. The wall clock decides how many ticks run and enters no state.

pub mod camera;
pub mod controls;
pub mod exposure;
pub mod insets;
pub mod keys;
mod orders;
pub mod overlay;
pub mod panel;
pub mod playback;
pub mod recorded;
mod style;
pub mod timeline;
pub mod tracks;

use crate::components::capture::Frames;
use crate::components::run::{Kept, PartError, SimClock};
use crate::components::view::{
    Pacing, Playback, ScreenshotRequest, Session, StepSize, Taken, WindowCamera, WindowFrame,
};
use crate::stop;
use crate::systems::render::renderer::Renderer;
use crate::systems::render::scene::sync_scene;
use crate::systems::run;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy_egui::input::EguiWantsInput;
use camera::LONGEST_FRAME_S;
use std::time::{Duration, Instant};

/// Wall-clock time that the ticks of a window frame may take.
const TICK_BUDGET: Duration = Duration::from_millis(50);
/// The same while nobody watches, on the way to a screenshot.
const UNWATCHED_BUDGET: Duration = Duration::from_secs(1);
/// Window frames that say that the scene is being built, before it is: the first may show nothing yet.
const WAITING_FRAMES: u32 = 3;
/// Window frames drawn before a screenshot, so that panels have found their sizes.
const SETTLE_FRAMES: u32 = 5;
/// Simulated time within which a step to the next exposure gives up [s].
const STEP_FRAME_LIMIT_S: f64 = 1.0;

/// Longest wall-clock time that a playback makes up for at once [s].
const LONGEST_PLAYED_S: f64 = 1.0;

/// One frame of the window: draw, then as many ticks as are due.
pub fn frame(world: &mut World) {
    let now = Instant::now();
    let Some(mut session) = world.remove_resource::<Session>() else {
        return;
    };
    let wall_s = (now - session.last).as_secs_f64();
    session.last = now;
    world.insert_resource(WindowFrame {
        active: true,
        waiting: session.waiting.is_some(),
        wall_s,
    });
    draw(world);
    world.resource_mut::<WindowFrame>().active = false;

    let mut failure = None;
    if stop::asked().is_some() {
        world.write_message(AppExit::Success);
    }
    let closing = !world.resource::<Messages<AppExit>>().is_empty();
    if let Some(drawn) = session.waiting {
        if closing {
            // Of a run that never began nothing is left.
            session.ended = None;
        } else {
            failure = build(world, &mut session, drawn + 1).err();
        }
    } else if !closing {
        let before = world.resource::<SimClock>().t_s();
        let budget = if session.screenshot.is_some() {
            UNWATCHED_BUDGET
        } else {
            TICK_BUDGET
        };
        let began = Instant::now();
        let in_budget = || began.elapsed() < budget;
        if world.contains_resource::<Playback>() {
            // Nothing is computed, so that a slow frame loses no time.
            playback::advance(world, wall_s.min(LONGEST_PLAYED_S));
        } else if let Err(error) = advance(world, wall_s.min(LONGEST_FRAME_S), in_budget) {
            failure = Some(error);
        }
        let simulated_s = world.resource::<SimClock>().t_s() - before;
        session.lately.push_back((wall_s, simulated_s));
        if session.lately.len() > 30 {
            session.lately.pop_front();
        }
        let (wall_s, simulated_s) = session
            .lately
            .iter()
            .fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
        let frames = session.lately.len() as f64;
        let mut pacing = world.resource_mut::<Pacing>();
        pacing.reached = simulated_s / wall_s.max(1e-9);
        pacing.frames_hz = frames / wall_s.max(1e-9);
        match picture(world, &mut session.screenshot) {
            Ok(false) => {}
            Ok(true) => {
                world.write_message(AppExit::Success);
            }
            Err(error) => failure = Some(error),
        }
    }
    if failure.is_some() {
        world.write_message(AppExit::error());
    }
    if !world.resource::<Messages<AppExit>>().is_empty()
        && let Some(ended) = session.ended.take()
    {
        ended(
            world,
            failure.map_or(Ok(()), Err),
            session.started.elapsed(),
        );
    }
    world.insert_resource(session);
}

/// Builds the run, once the window has been `drawn` often enough to show that it will.
fn build(world: &mut World, session: &mut Session, drawn: u32) -> Result<(), PartError> {
    session.waiting = Some(drawn);
    if drawn < WAITING_FRAMES {
        return Ok(());
    }
    session.waiting = None;
    run::set_up(world)?;
    if let Some(at_s) = session.screenshot.as_ref().and_then(|shot| shot.at_s) {
        let tick = world.resource::<SimClock>().ticks_of(at_s);
        let mut pacing = world.resource_mut::<Pacing>();
        pacing.speed = f64::INFINITY;
        pacing.pause_at = Some(tick);
        pacing.paused = tick == 0;
    }
    // What the set-up took is no time of the run.
    session.last = Instant::now();
    Ok(())
}

/// Draws the window; no sensor camera is active meanwhile.
fn draw(world: &mut World) {
    let Some(mut renderer) = Kept::<Renderer>::take(world) else {
        return;
    };
    let activate = |world: &mut World, active: bool| {
        let mut cameras = world.query_filtered::<&mut Camera, With<WindowCamera>>();
        for mut camera in cameras.iter_mut(world) {
            camera.is_active = active;
        }
    };
    activate(world, true);
    if !world.resource::<WindowFrame>().waiting {
        sync_scene(world);
    }
    renderer.render(world);
    activate(world, false);
    Kept::put(world, renderer);
}

/// Runs the ticks that are due after `wall_s` more seconds of wall-clock time [s], as long as
/// `in_budget` says that there is time for another; returns how many ran.
pub fn advance(
    world: &mut World,
    wall_s: f64,
    mut in_budget: impl FnMut() -> bool,
) -> Result<u64, PartError> {
    let clock = *world.resource::<SimClock>();
    let mut pacing = world.resource_mut::<Pacing>();
    if pacing.over {
        return Ok(0);
    }
    let step = pacing.step.take();
    let mut due = match step {
        Some(StepSize::Tick) => 1,
        Some(StepSize::Frame) => clock.ticks_of(STEP_FRAME_LIMIT_S),
        None if pacing.paused => return Ok(0),
        None if pacing.speed.is_infinite() => u64::MAX,
        None => {
            pacing.owed_ticks += wall_s * pacing.speed * f64::from(clock.tick_hz);
            pacing.owed_ticks as u64
        }
    };
    if let (None, Some(pause_at)) = (step, pacing.pause_at) {
        due = due.min(pause_at.saturating_sub(clock.tick));
    }
    let mut ran = 0;
    while ran < due && (step.is_some() || in_budget()) {
        let over = run::step(world)?;
        ran += 1;
        if over {
            world.resource_mut::<Pacing>().over = true;
            break;
        }
        if step == Some(StepSize::Frame) && !world.resource::<Frames>().0.is_empty() {
            break;
        }
    }
    let tick = clock.tick + ran;
    let mut pacing = world.resource_mut::<Pacing>();
    // What did not fit into the budget is forgotten: the pace drops, no backlog grows.
    pacing.owed_ticks = if step.is_none() && ran == due && pacing.speed.is_finite() {
        pacing.owed_ticks - ran as f64
    } else {
        0.0
    };
    if pacing.pause_at.is_some_and(|pause_at| tick >= pause_at) {
        pacing.pause_at = None;
        pacing.paused = true;
    }
    Ok(ran)
}

/// Takes the picture of the window once its time has come; true when it is saved.
fn picture(world: &mut World, shot: &mut Option<ScreenshotRequest>) -> Result<bool, PartError> {
    let pacing = world.resource::<Pacing>();
    let Some(shot) = shot.as_mut().filter(|_| pacing.paused || pacing.over) else {
        return Ok(false);
    };
    shot.drawn += 1;
    if shot.drawn == SETTLE_FRAMES {
        world.spawn(Screenshot::primary_window()).observe(
            |taken: On<ScreenshotCaptured>, mut commands: Commands| {
                commands.insert_resource(Taken(taken.image.clone()));
            },
        );
    }
    let Some(Taken(image)) = world.remove_resource::<Taken>() else {
        return Ok(false);
    };
    image.try_into_dynamic()?.to_rgb8().save(&shot.file)?;
    Ok(true)
}

/// Pause and single steps from the keyboard.
pub fn obey_keys(
    keys: Res<ButtonInput<KeyCode>>,
    wants: Res<EguiWantsInput>,
    mut pacing: ResMut<Pacing>,
) {
    if wants.wants_any_keyboard_input() {
        return;
    }
    if keys.just_pressed(KeyCode::Space) {
        pacing.paused = !pacing.paused;
    }
    for (key, step) in [
        (KeyCode::Period, StepSize::Tick),
        (KeyCode::Slash, StepSize::Frame),
    ] {
        if keys.just_pressed(key) {
            pacing.paused = true;
            pacing.step = Some(step);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::{self, Options};
    use crate::components::record::StateHash;
    use crate::scenario::Scenario;
    use std::path::Path;

    fn app() -> App {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/urban_intercept.toml");
        let loaded = match Scenario::load(&path, &["detector.kind=truth".into()]) {
            Ok(loaded) => loaded,
            Err(error) => panic!("{error}"),
        };
        match app::build(&loaded, &Options::default()) {
            Ok(app) => app,
            Err(error) => panic!("{error}"),
        }
    }

    fn advanced(world: &mut World, wall_s: f64) -> u64 {
        match advance(world, wall_s, || true) {
            Ok(ran) => ran,
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn pause_step_resume_run_the_ticks_of_a_run_without_window() {
        let mut app = app();
        let world = app.world_mut();
        let hz = f64::from(world.resource::<SimClock>().tick_hz);
        world.insert_resource(Pacing {
            paused: true,
            ..Pacing::default()
        });
        assert_eq!(advanced(world, 10.0), 0);
        assert_eq!(world.resource::<SimClock>().tick, 0);

        world.resource_mut::<Pacing>().step = Some(StepSize::Tick);
        assert_eq!(advanced(world, 10.0), 1);
        assert_eq!(advanced(world, 10.0), 0);
        assert_eq!(world.resource::<SimClock>().tick, 1);

        // A step to the next exposure ends on the tick that exposes.
        world.resource_mut::<Pacing>().step = Some(StepSize::Frame);
        let to_frame = advanced(world, 0.0);
        assert!(!world.resource::<Frames>().0.is_empty());
        assert_eq!(world.resource::<SimClock>().tick, 1 + to_frame);

        // Three eighths of a tick at a time: the rest is carried over, none is lost.
        world.resource_mut::<Pacing>().paused = false;
        let parts: Vec<u64> = (0..8).map(|_| advanced(world, 0.375 / hz)).collect();
        assert_eq!(parts, [0, 0, 1, 0, 0, 1, 0, 1]);
        world.resource_mut::<Pacing>().speed = 0.5;
        assert_eq!(advanced(world, 200.0 / hz), 100);

        // Time that the budget does not hold is dropped, not made up for later.
        let mut left = 7;
        let budget = || {
            left -= 1;
            left >= 0
        };
        assert!(matches!(advance(world, 100.0 / hz, budget), Ok(7)));
        assert_eq!(advanced(world, 0.0), 0);

        // As fast as possible, to a set tick.
        let tick = world.resource::<SimClock>().tick;
        let mut pacing = world.resource_mut::<Pacing>();
        (pacing.speed, pacing.pause_at) = (f64::INFINITY, Some(tick + 50));
        assert_eq!(advanced(world, 0.0), 50);
        assert!(world.resource::<Pacing>().paused);

        let ticks = world.resource::<SimClock>().tick;
        assert_eq!(ticks, 1 + to_frame + 3 + 100 + 7 + 50);
        let paced = *world.resource::<StateHash>();
        let mut plain = self::app();
        for _ in 0..ticks {
            assert!(matches!(app::step(plain.world_mut()), Ok(false)));
        }
        assert_eq!(paced, *plain.world().resource::<StateHash>());
    }
}
