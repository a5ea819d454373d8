//! Noise that is the same again a moment later.

use crate::maths::rng::Stream;
use serde::{Deserialize, Serialize};

/// Times over which the middle parts of [`Noise`] change [s]; twice as far apart they are independent.
const CHANGE_S: [f64; 2] = [0.25, 2.0]; // [s]

/// How normal noise of unit variance goes on: shares of the variance that are new in every frame, change over a quarter of a
/// second and over two seconds, and last for good.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// New in every frame.
    pub frame: f64,
    /// Over a quarter of a second, and over two.
    pub changing: [f64; 2],
    /// The same for as long as the run lasts.
    pub lasting: f64,
}

impl Noise {
    /// Whether its parts are shares.
    pub fn is_sound(&self) -> bool {
        let [quick, slow] = self.changing;
        [self.frame, quick, slow, self.lasting]
            .iter()
            .all(|share| (0.0..=1.0).contains(share))
    }
}

/// What noise is drawn for: each has its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// Whether a thing is found, and how surely.
    Score,
    /// The class that is named.
    Name,
    /// Where the box's middle lies, across and down.
    Right,
    Down,
    /// How large the box is, across and down.
    Width,
    Height,
    /// What the recogniser answers.
    Recognised,
}

const PURPOSES: usize = Of::Recognised as usize + 1;

/// The draws of a thing in a frame, normal and of unit variance, for every purpose: new in this frame, between the ends of
/// either span about it, and lasting.
#[derive(Clone, Copy, Debug)]
pub struct Draws {
    parts: [[f64; 4]; PURPOSES],
    /// More that last: the spread of a thing's boxes, and how far off their mean is, across and down.
    pub spread: f64,
    pub mean: [f64; 2],
    /// One of the frame, even from 0 to 1.
    pub even: f64,
}

impl Draws {
    /// Those of thing number `thing` of a run under its seed at a time [s], in a frame of that number; two cameras see the same
    /// but for what is new in every frame.
    pub fn new(seed: u64, thing: u64, t_s: f64, frame: u64) -> Self {
        let stream = |part: &str, number: u64| {
            let key = thing.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number;
            Stream::new(seed, key, part)
        };
        let each = |stream: &mut Stream| [(); PURPOSES].map(|()| stream.normal());
        let mut of_frame = stream("measured frame", frame);
        let mut for_good = stream("measured lasting", 0);
        let mut columns = [[0.0; PURPOSES]; 4];
        columns[0] = each(&mut of_frame);
        columns[3] = each(&mut for_good);
        for (span, (change_s, name)) in CHANGE_S
            .iter()
            .zip(["measured quick", "measured slow"])
            .enumerate()
        {
            let steps = t_s / change_s;
            let (number, later) = (steps.floor(), steps - steps.floor());
            let [from, to] =
                [number, number + 1.0].map(|number| each(&mut stream(name, number as u64)));
            let unit = (1.0 - later).hypot(later);
            columns[1 + span] = std::array::from_fn(|purpose| {
                ((1.0 - later) * from[purpose] + later * to[purpose]) / unit
            });
        }
        Self {
            parts: std::array::from_fn(|purpose| columns.map(|column| column[purpose])),
            spread: for_good.normal(),
            mean: [for_good.normal(), for_good.normal()],
            even: of_frame.uniform(),
        }
    }

    /// Noise for a purpose that goes on in such shares.
    pub fn noise(&self, purpose: Of, shares: &Noise) -> f64 {
        let Noise {
            frame,
            changing: [quick, slow],
            lasting,
        } = *shares;
        let parts = self.parts[purpose as usize]
            .iter()
            .zip([frame, quick, slow, lasting]);
        parts.map(|(draw, share)| share.sqrt() * draw).sum()
    }
}
