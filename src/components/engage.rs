//! Rules of engagement, interlocks and burst.

use crate::models::engage::interlock::Zone;
use bevy::prelude::*;

/// The rules of engagement of a run.
#[derive(Component, Clone, Debug)]
pub struct Rules {
    /// Whether the laser may fire at all.
    pub authorised: bool,
    /// Protected regions.
    pub keep_out: Vec<Zone>,
    /// Least angle from a risen sun [rad].
    pub sun_exclusion_rad: f64,
    /// Least probability that the target is a UAV.
    pub min_uav_probability: f64,
    /// Size from which on a target is too large for a UAV [m].
    pub max_span_m: f64,
    /// How far ahead the line of sight is checked [s].
    pub look_ahead_s: f64,
    /// Radius of the beam at its exit [m]; on its way to the target it is nowhere wider.
    pub beam_radius_m: f64,
    /// Whether open sky may lie behind the target.
    pub allow_sky: bool,
    /// Whether the ground may.
    pub allow_ground: bool,
    /// Whether a building or a tree may.
    pub allow_building: bool,
    /// How far behind the target what is solid must be [m].
    pub min_clear_range_m: f64,
    /// Longest burst [s].
    pub max_burst_s: f64,
    /// Least pause after a burst of that length [s].
    pub pause_s: f64,
}

/// Why the laser does not fire.
#[derive(Component, Clone, Debug, Default)]
pub struct Interlocks {
    /// The reasons; none while it may.
    pub reasons: Vec<&'static str>,
    /// The track whose surroundings were last looked over, and what spoke against firing at it there.
    pub looked_over: Option<(u32, Vec<&'static str>)>,
}

/// When the present burst began, and when the last full one ended.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Burst {
    /// First tick of the present burst.
    pub began: Option<u64>,
    /// Last tick of a burst that ran into its limit.
    pub exhausted: Option<u64>,
}
