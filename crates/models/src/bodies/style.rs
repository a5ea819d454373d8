//! How one UAV of a model is painted and fitted out.

use glam::DVec2;

use crate::flight::shape::Coat;
use crate::maths::rng::Stream;
use crate::shape::mesh::Paint;

// Linear RGB albedos.
pub(super) const BLACK: [f32; 3] = [0.02, 0.02, 0.022];
pub(super) const CARBON: [f32; 3] = [0.035, 0.035, 0.038];
pub(super) const DARK: [f32; 3] = [0.085, 0.09, 0.095];
pub(super) const GREY: [f32; 3] = [0.3, 0.31, 0.32];
pub(super) const SILVER: [f32; 3] = [0.5, 0.5, 0.51];
pub(super) const WHITE: [f32; 3] = [0.78, 0.78, 0.76];
pub(super) const LENS: [f32; 3] = [0.012, 0.014, 0.025];
pub(super) const RED: [f32; 3] = [0.5, 0.03, 0.02];
pub(super) const ORANGE: [f32; 3] = [0.55, 0.17, 0.02];
pub(super) const YELLOW: [f32; 3] = [0.6, 0.4, 0.03];
pub(super) const BLUE: [f32; 3] = [0.02, 0.04, 0.16];
pub(super) const GREEN: [f32; 3] = [0.06, 0.22, 0.05];
pub(super) const CARDBOARD: [f32; 3] = [0.36, 0.23, 0.12];

/// Whose arms and hull a UAV has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameStyle {
    /// As the maker of the model builds them.
    Maker,
    /// A self-built frame on the model's hubs: two plates, battery and receiver dome between deep
    /// ribbed arms that end in feet.
    Ribbed,
}

/// What a UAV carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// Nothing.
    None,
    /// A box below the hull.
    Box,
    /// A lying cylinder below the hull.
    Cylinder,
    /// A large gimbal camera below the hull.
    Camera,
    /// A parcel on a line.
    Parcel,
}

/// What a UAV lands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gear {
    /// What the frame has, lowered.
    Lowered,
    /// Nothing: retracted or taken off.
    Raised,
    /// Two skids on raked struts.
    Skids,
    /// A thin leg below each motor.
    Legs,
}

/// How one UAV of a model is painted and fitted out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UavStyle {
    /// Paint; None: the maker's.
    pub coat: Option<Coat>,
    /// Arms and hull.
    pub frame: FrameStyle,
    /// What it carries.
    pub payload: Payload,
    /// What it lands on.
    pub gear: Gear,
    /// Blades of a propeller.
    pub blades: u32,
    /// Whether rings guard the propellers.
    pub guards: bool,
    /// Whether a positioning receiver stands on a mast.
    pub mast: bool,
    /// Whether two rod antennas stick out at the back.
    pub antennas: bool,
    /// Its size over the model's published one.
    pub scale: f64,
}

impl UavStyle {
    /// The model as the catalogue publishes it.
    pub fn standard() -> Self {
        Self {
            coat: None,
            frame: FrameStyle::Maker,
            payload: Payload::None,
            gear: Gear::Lowered,
            blades: 2,
            guards: false,
            mast: false,
            antennas: false,
            scale: 1.0,
        }
    }

    /// A style drawn from `rng`. The shares are assumptions: a third stay as the maker paints them,
    /// a third fly a self-built frame, most carry nothing; sizes lie within 8 % of the published.
    pub fn drawn(rng: &mut Stream) -> Self {
        let coat = (rng.uniform() > 0.33).then(|| Coat::drawn(rng));
        let frame = if rng.uniform() < 0.35 {
            FrameStyle::Ribbed
        } else {
            FrameStyle::Maker
        };
        let payload = match rng.uniform() {
            u if u < 0.64 => Payload::None,
            u if u < 0.74 => Payload::Box,
            u if u < 0.80 => Payload::Cylinder,
            u if u < 0.92 => Payload::Camera,
            _ => Payload::Parcel,
        };
        let gear = match rng.uniform() {
            u if u < 0.55 => Gear::Lowered,
            u if u < 0.75 => Gear::Raised,
            u if u < 0.88 => Gear::Skids,
            _ => Gear::Legs,
        };
        Self {
            coat,
            frame,
            payload,
            gear,
            blades: if rng.uniform() < 0.82 { 2 } else { 3 },
            guards: rng.uniform() < 0.08,
            mast: rng.uniform() < 0.2,
            antennas: rng.uniform() < 0.25,
            scale: rng.range(0.92, 1.08),
        }
    }
}

impl Coat {
    /// One or two colours, and propellers of their own.
    fn drawn(rng: &mut Stream) -> Self {
        const COLOURS: [[f32; 3]; 14] = [
            WHITE, WHITE, WHITE, SILVER, GREY, GREY, DARK, DARK, BLACK, CARBON, BLUE, ORANGE, RED,
            YELLOW,
        ];
        let colour = |rng: &mut Stream| {
            let paint = rng.pick(&COLOURS);
            let tone = rng.range(0.8, 1.15) as f32;
            paint.map(|c| (c * tone).min(0.85))
        };
        let shell = colour(rng);
        let second = if rng.uniform() < 0.5 {
            CARBON
        } else {
            colour(rng)
        };
        let front = if rng.uniform() < 0.45 { shell } else { second };
        // Pilots of self-built frames tell front from back by the colour of the arms.
        let rear = if rng.uniform() < 0.25 {
            colour(rng)
        } else {
            front
        };
        Self {
            shell,
            arms: [front, rear],
            gear: if rng.uniform() < 0.5 { second } else { shell },
            motor: if rng.uniform() < 0.5 { SILVER } else { BLACK },
            blades: match rng.uniform() {
                u if u < 0.72 => CARBON,
                u if u < 0.82 => GREY,
                u if u < 0.9 => WHITE,
                _ => colour(rng),
            },
        }
    }

    /// Paint of the arm that carries a hub.
    pub(super) fn arm(&self, hub: DVec2) -> Paint {
        Paint::plain(self.arms[usize::from(hub.x < 0.0)])
    }
}
