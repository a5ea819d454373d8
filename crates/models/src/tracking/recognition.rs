//! What a track is, from its last second: the history of a track, and what a network is given of it.
//!
//! The second is cut into [`STEPS`] steps on a grid of absolute time. Of each step the finest camera
//! that saw the track counts, with one chip and the boxes of all its frames. Directions are those on
//! the sky, so that the camera's motion is out of them as far as the station knows it.

use crate::flight::class::ObjectClass;
use crate::maths::kinematics::wrap_pi;
use crate::optics::chip::Chip;
use crate::optics::tier::Tier;
use glam::DVec2;
use std::collections::VecDeque;

/// What a track may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TrackClass {
    /// A UAV.
    Uav,
    /// A bird, flapping or gliding.
    Bird,
    /// An aeroplane.
    Aeroplane,
    /// A helicopter.
    Helicopter,
    /// A balloon.
    Balloon,
    /// Anything else, scenery above all.
    Other,
}

/// How many classes there are.
pub const CLASSES: usize = 6;

impl TrackClass {
    /// All, in the order in which a network gives their probabilities.
    pub const ALL: [Self; CLASSES] = [
        Self::Uav,
        Self::Bird,
        Self::Aeroplane,
        Self::Helicopter,
        Self::Balloon,
        Self::Other,
    ];

    /// The name that models and data sets use: `uav`, or that of the class of objects.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uav => "uav",
            Self::Bird => ObjectClass::Bird.name(),
            Self::Aeroplane => ObjectClass::Aeroplane.name(),
            Self::Helicopter => ObjectClass::Helicopter.name(),
            Self::Balloon => ObjectClass::Balloon.name(),
            Self::Other => ObjectClass::Other.name(),
        }
    }

    /// What a detector's class stands for: every unknown name is a kind of UAV.
    pub fn of_detector(name: &str) -> Self {
        ObjectClass::of_name(name).map_or(Self::Uav, Self::from)
    }
}

impl From<ObjectClass> for TrackClass {
    fn from(class: ObjectClass) -> Self {
        match class {
            ObjectClass::Fpv | ObjectClass::Quadcopter | ObjectClass::Hexacopter => Self::Uav,
            ObjectClass::Bird => Self::Bird,
            ObjectClass::Aeroplane => Self::Aeroplane,
            ObjectClass::Helicopter => Self::Helicopter,
            ObjectClass::Balloon => Self::Balloon,
            ObjectClass::Other => Self::Other,
        }
    }
}

/// Time over which answers are averaged [s].
const JUDGED_OVER_S: f64 = 0.4; // [s]

/// What a track was found to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recognition {
    /// Probability of each class, in the order of [`TrackClass::ALL`].
    pub probabilities: [f64; CLASSES],
    /// End of the second that it was found from [s].
    pub t_s: f64,
}

impl Recognition {
    /// This one, found after another: one answer alone overturns no judgement.
    pub fn after(&self, before: &Self) -> Self {
        let share = 1.0 - (-(self.t_s - before.t_s).max(0.0) / JUDGED_OVER_S).exp();
        let mean = |i: usize| {
            before.probabilities[i] + share * (self.probabilities[i] - before.probabilities[i])
        };
        Self {
            probabilities: std::array::from_fn(mean),
            t_s: self.t_s,
        }
    }

    /// This one, once something else is known that is so many times as likely of these classes as of any other.
    pub fn weighed(&self, classes: &[TrackClass], times: f64) -> Self {
        let mut probabilities = self.probabilities;
        for class in classes {
            probabilities[*class as usize] *= times;
        }
        let sum: f64 = probabilities.iter().sum();
        Self {
            probabilities: probabilities.map(|p| p / sum),
            t_s: self.t_s,
        }
    }

    /// Probability that it is a UAV.
    pub fn p_uav(&self) -> f64 {
        self.probabilities[TrackClass::Uav as usize]
    }

    /// The most probable class.
    pub fn class(&self) -> TrackClass {
        let mut best = TrackClass::Uav;
        for class in TrackClass::ALL {
            if self.probabilities[class as usize] > self.probabilities[best as usize] {
                best = class;
            }
        }
        best
    }
}

/// Steps of a sequence.
pub const STEPS: usize = 16;
/// Time that a sequence covers [s].
pub const WINDOW_S: f64 = 1.0; // [s]
const STEPS_PER_S: f64 = STEPS as f64 / WINDOW_S;
/// Steps with a detection from which on a sequence says something.
pub const LEAST_STEPS: usize = 3;
/// Side of a chip over that of the track's box, and the least [px]: a dot wants surroundings.
const CHIP_OVER_BOX: f64 = 2.0;
const LEAST_CHIP_PX: f64 = 16.0; // [px]

/// Names of a step's features, as a model lists them; [`History::sequence`] says how they are made.
pub const FEATURES: [&str; 22] = [
    "age_s",
    "sky_known",
    "right_sizes",
    "up_sizes",
    "rate_right",
    "rate_up",
    "rate_sizes",
    "position_flutter",
    "log_size_mrad",
    "log_size_px",
    "log_size_change",
    "log_aspect",
    "log_aspect_change",
    "size_flutter",
    "score",
    "seen_share",
    "named_uav",
    "named_bird",
    "named_aeroplane",
    "named_helicopter",
    "named_balloon",
    "named_other",
];

/// One detection of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glimpse {
    /// Tick of the exposure.
    pub tick: u64,
    /// Its time [s].
    pub t_s: f64,
    /// What the camera is for.
    pub tier: Tier,
    /// Azimuth and elevation of the box's middle [rad].
    pub az_el_rad: DVec2,
    /// Middle of the box in pixels of the sensor.
    pub centre_px: [f64; 2],
    /// Width and height of the box [px].
    pub size_px: [f64; 2],
    /// Field of view of a pixel [rad].
    pub ifov_rad: f64,
    /// Confidence of the detector, and what it calls it, if anything.
    pub score: f64,
    pub named: Option<TrackClass>,
}

impl Glimpse {
    /// Larger side of the box [rad]; one without extent counts as a tenth of a pixel.
    fn side_rad(&self) -> f64 {
        self.size_px[0].max(self.size_px[1]).max(0.1) * self.ifov_rad
    }

    fn log_aspect(&self) -> f64 {
        (self.size_px[0].max(0.1) / self.size_px[1].max(0.1)).ln()
    }

    /// Side of the chip for a track whose box is `side_rad` [rad] large [px].
    pub fn chip_px(&self, side_rad: f64) -> f64 {
        (CHIP_OVER_BOX * side_rad / self.ifov_rad).max(LEAST_CHIP_PX)
    }
}

/// A step of a track's history.
#[derive(Clone, Debug)]
pub struct Step {
    /// Its number since time 0.
    number: i64,
    /// The detections by the finest camera that saw the track; the first is that of the chip.
    pub glimpses: Vec<Glimpse>,
    /// What the first of them shows.
    pub chip: Chip,
}

/// A track's last second.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// Steps with a detection, oldest first.
    steps: VecDeque<Step>,
}

fn step_of(t_s: f64) -> i64 {
    // Exposures at the very edge belong to the later step, however the division rounds.
    (t_s * STEPS_PER_S + 1e-9).floor() as i64
}

impl History {
    /// Takes in a detection; its chip is made only where the step keeps it.
    pub fn take(&mut self, glimpse: Glimpse, chip: impl FnOnce() -> Chip) {
        let number = step_of(glimpse.t_s);
        let at = self.steps.partition_point(|step| step.number < number);
        match self.steps.get_mut(at).filter(|step| step.number == number) {
            Some(step) => match glimpse.tier.cmp(&step.glimpses[0].tier) {
                std::cmp::Ordering::Less => {}
                std::cmp::Ordering::Equal => step.glimpses.push(glimpse),
                std::cmp::Ordering::Greater => {
                    step.glimpses = vec![glimpse];
                    step.chip = chip();
                }
            },
            None => {
                let step = Step {
                    number,
                    glimpses: vec![glimpse],
                    chip: chip(),
                };
                self.steps.insert(at, step);
            }
        }
        self.forget();
    }

    /// Goes on as another history, of a track that turned out to be the same.
    pub fn join(&mut self, other: Self) {
        for step in other.steps {
            self.steps.retain(|own| own.number != step.number);
            let at = (self.steps).partition_point(|own| own.number < step.number);
            self.steps.insert(at, step);
        }
        self.forget();
    }

    /// Drops what no later sequence holds.
    fn forget(&mut self) {
        let newest = self.steps.back().map_or(0, |step| step.number);
        // The newest has perhaps just begun, and is not looked at yet.
        (self.steps).retain(|step| step.number >= newest - STEPS as i64);
    }

    /// The second of whole steps that ends by `t_s`, of a track that was seen in `seen_share` of its frames; `None`
    /// for one that was seen in fewer than [`LEAST_STEPS`] steps. `sky_known`: whether directions are
    /// those on the sky; otherwise the features of motion are 0.
    ///
    /// Features of a step: the mean age of its detections; their place about a straight flight at
    /// constant rates through the whole second, to the right and up, over the median size, and their
    /// rms about that place; the rates [mrad/s], and their length over the size [1/s]; the logs of the
    /// size in mrad, in pixels and over the median, and of width over height, that and its change from
    /// the second's mean; the rms of the log of the size in the step; the mean score; the share of the
    /// frames; and the share of the score by what the detector calls it. Rates and places go through
    /// the inverse hyperbolic sine, so that outliers stay bounded.
    pub fn sequence(&self, t_s: f64, seen_share: f64, sky_known: bool) -> Option<Sequence> {
        // What has just begun has seen nothing yet.
        let last = step_of(t_s - 0.5 / STEPS_PER_S);
        let within = |step: &&Step| (last - STEPS as i64 + 1..=last).contains(&step.number);
        let steps: Vec<&Step> = self.steps.iter().filter(within).collect();
        if steps.len() < LEAST_STEPS {
            return None;
        }
        let second = Second::of(&steps);
        let mut sequence = Sequence {
            flight: sky_known.then(|| second.flight(&steps)),
            ..Sequence::default()
        };
        for step in steps {
            let at = (step.number - (last - STEPS as i64 + 1)) as usize;
            let mut features = second.features(step, t_s, sky_known);
            features[FEATURE_SEEN] = seen_share;
            sequence.features[at] = features.map(|value| value as f32);
            sequence.steps[at] = Some(step.clone());
        }
        Some(sequence)
    }
}

/// Where `seen_share` stands among the features.
const FEATURE_SEEN: usize = 15;

/// What a network is given: a track's last second, oldest step first.
#[derive(Clone, Debug, Default)]
pub struct Sequence {
    /// The steps in which it was seen.
    pub steps: [Option<Step>; STEPS],
    /// Their features, by [`FEATURES`]; 0 where it was not seen.
    pub features: [[f32; FEATURES.len()]; STEPS],
    /// How it flew on the sky; `None` where directions are not those on the sky.
    pub flight: Option<Flight>,
}

/// The straight flight at constant rates that suits a second best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Its rates, right and up [rad/s].
    pub rate_radps: DVec2,
    /// From the first detection to the last [s].
    pub span_s: f64,
}

/// What the features of all steps refer to.
struct Second {
    /// Direction and time that the places count from [rad, s].
    origin: (DVec2, f64),
    /// Place at that time [rad], and rate [rad/s], right and up on the sky.
    place_rad: DVec2,
    rate_radps: DVec2,
    /// Median size [rad], mean log of width over height.
    side_rad: f64,
    log_aspect: f64,
}

impl Second {
    fn of(steps: &[&Step]) -> Self {
        let glimpses = || steps.iter().flat_map(|step| &step.glimpses);
        let count = glimpses().count().max(1) as f64;
        let mut sides_rad: Vec<f64> = glimpses().map(Glimpse::side_rad).collect();
        sides_rad.sort_by(f64::total_cmp);
        let mean_t_s = glimpses().map(|glimpse| glimpse.t_s).sum::<f64>() / count;
        let first = glimpses()
            .next()
            .map_or(DVec2::ZERO, |first| first.az_el_rad);
        let mut second = Self {
            origin: (first, mean_t_s),
            place_rad: DVec2::ZERO,
            rate_radps: DVec2::ZERO,
            side_rad: sides_rad.get(sides_rad.len() / 2).copied().unwrap_or(1.0),
            log_aspect: glimpses().map(Glimpse::log_aspect).sum::<f64>() / count,
        };
        // Least squares of a straight line; a step weighs the same however many frames it has.
        let (mut weights, mut time, mut square) = (0.0, 0.0, 0.0);
        let (mut place, mut moment) = (DVec2::ZERO, DVec2::ZERO);
        for step in steps {
            let weight = 1.0 / step.glimpses.len() as f64;
            for glimpse in &step.glimpses {
                let (dt_s, at) = (glimpse.t_s - mean_t_s, second.place(glimpse));
                weights += weight;
                time += weight * dt_s;
                square += weight * dt_s * dt_s;
                place += weight * at;
                moment += weight * dt_s * at;
            }
        }
        let spread = weights * square - time * time;
        if spread > 0.0 {
            second.rate_radps = (weights * moment - time * place) / spread;
        }
        second.place_rad = (place - time * second.rate_radps) / weights;
        second
    }

    fn flight(&self, steps: &[&Step]) -> Flight {
        let times_s = || {
            let glimpses = steps.iter().flat_map(|step| &step.glimpses);
            glimpses.map(|glimpse| glimpse.t_s)
        };
        let span_s = times_s().fold(f64::MIN, f64::max) - times_s().fold(f64::MAX, f64::min);
        Flight {
            rate_radps: self.rate_radps,
            span_s,
        }
    }

    /// Where a detection is from the origin, right and up [rad].
    fn place(&self, glimpse: &Glimpse) -> DVec2 {
        let DVec2 { x, y } = glimpse.az_el_rad - self.origin.0;
        DVec2::new(wrap_pi(x) * self.origin.0.y.cos(), y)
    }

    /// Where it is from the straight flight [sizes].
    fn aside(&self, glimpse: &Glimpse) -> DVec2 {
        let flown = self.place_rad + self.rate_radps * (glimpse.t_s - self.origin.1);
        (self.place(glimpse) - flown) / self.side_rad
    }

    fn features(&self, step: &Step, t_s: f64, sky_known: bool) -> [f64; FEATURES.len()] {
        let glimpses = &step.glimpses;
        let count = glimpses.len() as f64;
        let mean = |of: &dyn Fn(&Glimpse) -> f64| glimpses.iter().map(of).sum::<f64>() / count;
        let rms = |of: &dyn Fn(&Glimpse) -> f64| {
            let middle = mean(of);
            mean(&|glimpse| (of(glimpse) - middle).powi(2)).sqrt()
        };
        let log_side = |glimpse: &Glimpse| glimpse.side_rad().ln();
        let log_side_rad = mean(&log_side);
        let log_aspect = mean(&Glimpse::log_aspect);
        let mut features = [0.0; FEATURES.len()];
        features[0] = mean(&|glimpse| glimpse.t_s) - t_s;
        if sky_known {
            let [right, up] = [|at: DVec2| at.x, |at: DVec2| at.y];
            let flutter = rms(&|g| right(self.aside(g))).hypot(rms(&|g| up(self.aside(g))));
            features[1] = 1.0;
            features[2] = mean(&|g| right(self.aside(g))).asinh();
            features[3] = mean(&|g| up(self.aside(g))).asinh();
            features[4] = (1e3 * self.rate_radps.x).asinh();
            features[5] = (1e3 * self.rate_radps.y).asinh();
            features[6] = (self.rate_radps.length() / self.side_rad).asinh();
            features[7] = flutter.asinh();
        }
        features[8] = log_side_rad + 1e3_f64.ln();
        features[9] = mean(&|glimpse| (glimpse.side_rad() / glimpse.ifov_rad).ln());
        features[10] = log_side_rad - self.side_rad.ln();
        features[11] = log_aspect;
        features[12] = log_aspect - self.log_aspect;
        features[13] = rms(&log_side);
        features[14] = mean(&|glimpse| glimpse.score);
        let total: f64 = glimpses.iter().map(|glimpse| glimpse.score).sum();
        for glimpse in glimpses {
            if let Some(class) = glimpse.named {
                features[FEATURE_SEEN + 1 + class as usize] += glimpse.score / total.max(1e-9);
            }
        }
        features
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    fn glimpse(t_s: f64, tier: Tier, az_el_rad: DVec2) -> Glimpse {
        Glimpse {
            tick: (t_s * 960.0).round() as u64,
            t_s,
            tier,
            az_el_rad,
            centre_px: [100.0, 80.0],
            size_px: [12.0, 6.0],
            ifov_rad: 5e-5,
            score: 0.8,
            named: Some(TrackClass::Uav),
        }
    }

    fn chip(value: u8) -> Chip {
        vec![value; 3].into()
    }

    fn feature(sequence: &Sequence, step: usize, name: &str) -> f64 {
        let at = FEATURES
            .iter()
            .position(|feature| *feature == name)
            .unwrap();
        f64::from(sequence.features[step][at])
    }

    #[test]
    fn training_cuts_chips_as_the_loop_does() {
        let interface = include_str!("../../../../training/recogniser_interface.py");
        let sides =
            format!("CHIP_OVER_BOX, LEAST_CHIP_PX = {CHIP_OVER_BOX:?}, {LEAST_CHIP_PX:?}  #");
        assert!(interface.contains(&sides), "{sides}");
    }

    #[test]
    fn one_answer_overturns_no_judgement() {
        let found = |p_uav: f64, t_s: f64| {
            let mut probabilities = [0.0; CLASSES];
            (probabilities[0], probabilities[1]) = (p_uav, 1.0 - p_uav);
            Recognition { probabilities, t_s }
        };
        let mut now = found(0.95, 0.0);
        let mut after_s = 0.0;
        while now.p_uav() > 0.5 {
            after_s += 0.125;
            now = found(0.05, after_s).after(&now);
            assert!((now.probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        // A mean over 0.4 s is half turned after 0.4 ln 2 s, at the next answer.
        assert_eq!(after_s, 0.375);
    }

    #[test]
    fn features_stand_where_their_names_say() {
        assert_eq!(FEATURES[FEATURE_SEEN], "seen_share");
        for class in TrackClass::ALL {
            let name = FEATURES[FEATURE_SEEN + 1 + class as usize];
            assert_eq!(name.strip_prefix("named_"), Some(class.name()));
            assert_eq!(TrackClass::of_detector(class.name()), class);
        }
        assert_eq!(TrackClass::of_detector("hexacopter"), TrackClass::Uav);
        assert_eq!(TrackClass::of_detector("bird"), TrackClass::Bird);
    }

    #[test]
    fn a_straight_flight_has_its_rate_and_no_wobble() {
        let mut rng = Stream::new(1, 0, "test");
        for _ in 0..50 {
            let mut history = History::default();
            let start = DVec2::new(rng.range(-4.0, 4.0), rng.range(-0.2, 1.0));
            // Rates on the sky; an azimuth turns faster by 1/cos(el).
            let rate = DVec2::new(rng.range(-0.05, 0.05), rng.range(-0.05, 0.05));
            let shift_s = rng.range(0.0, 100.0);
            for frame in 0..70 {
                let t_s = shift_s + f64::from(frame) / 60.0;
                let dt_s = t_s - shift_s;
                let az = wrap_pi(start.x + rate.x * dt_s / start.y.cos());
                let at = DVec2::new(az, start.y + rate.y * dt_s);
                // What is found by its motion alone has no name.
                let named = (frame % 2 == 0).then_some(TrackClass::Uav);
                let glimpse = Glimpse {
                    named,
                    ..glimpse(t_s, Tier::Coarse, at)
                };
                history.take(glimpse, || chip(1));
            }
            let t_s = shift_s + 69.0 / 60.0;
            let found = history.sequence(t_s, 0.9, true).unwrap();
            let flight = found.flight.unwrap();
            assert!((flight.rate_radps - rate).abs().max_element() < 5e-3);
            assert!((0.9..=1.0).contains(&flight.span_s), "{flight:?}");
            for step in 0..STEPS {
                // The cosine is that of the first of the second's frames.
                let right = (1e3 * rate.x).asinh();
                assert!((feature(&found, step, "rate_right") - right).abs() < 0.1);
                assert!((feature(&found, step, "rate_up") - (1e3 * rate.y).asinh()).abs() < 1e-4);
                for still in ["right_sizes", "up_sizes", "size_flutter", "log_size_change"] {
                    assert!(feature(&found, step, still).abs() < 0.02, "{still}");
                }
                assert!((feature(&found, step, "log_aspect") - 2.0_f64.ln()).abs() < 1e-6);
                assert!((feature(&found, step, "log_size_px") - 12.0_f64.ln()).abs() < 1e-6);
                let named = feature(&found, step, "named_uav");
                assert!((0.25..0.75).contains(&named), "{named}");
                assert!((feature(&found, step, "seen_share") - 0.9).abs() < 1e-6);
                assert!((-1.1..=0.0).contains(&feature(&found, step, "age_s")));
            }
        }
    }

    #[test]
    fn a_wingbeat_shows_in_size_and_shape() {
        let mut history = History::default();
        for frame in 0..60 {
            let t_s = f64::from(frame) / 60.0;
            let beat = (std::f64::consts::TAU * 3.1 * t_s).sin();
            let flaps = Glimpse {
                size_px: [20.0, 8.0 + 6.0 * beat],
                ..glimpse(t_s, Tier::Precise, DVec2::new(0.1, 0.1 + 2e-4 * beat))
            };
            history.take(flaps, || chip(1));
        }
        let found = history.sequence(59.0 / 60.0, 1.0, true).unwrap();
        let largest = |name: &str| {
            let all = (0..STEPS).map(|step| feature(&found, step, name).abs());
            all.fold(0.0, f64::max)
        };
        assert!(largest("log_aspect_change") > 0.5);
        assert!(largest("up_sizes") > 0.1 && largest("right_sizes") < 1e-3);
        // Where the camera's motion is not known, nothing is said of the track's.
        let blind = history.sequence(59.0 / 60.0, 1.0, false).unwrap();
        for (step, (name, silent)) in [("sky_known", 0.0), ("up_sizes", 0.0)].iter().enumerate() {
            assert_eq!(feature(&blind, step, name), *silent);
        }
        assert!(blind.flight.is_none() && found.flight.is_some());
    }

    #[test]
    fn the_finest_camera_of_a_step_counts_whatever_arrives_first() {
        let at = DVec2::new(0.1, 0.1);
        let seen = [
            (0.01, Tier::Search),
            (0.07, Tier::Coarse),
            (0.13, Tier::Precise),
            (0.02, Tier::Precise),
            (0.03, Tier::Search),
            (0.14, Tier::Coarse),
        ];
        let mut found = Vec::new();
        // Batches of slow cameras arrive late.
        for order in [[0, 1, 2, 3, 4, 5], [5, 3, 1, 0, 4, 2], [2, 4, 0, 5, 1, 3]] {
            let mut history = History::default();
            for (t_s, tier) in order.map(|k| seen[k]) {
                history.take(glimpse(t_s, tier, at), || chip(tier as u8));
            }
            let sequence = history.sequence(0.17, 1.0, true).unwrap();
            let tiers = sequence.steps.iter().flatten().map(|step| {
                assert_eq!(step.chip[0], step.glimpses[0].tier as u8);
                (step.number, step.glimpses[0].tier, step.glimpses.len())
            });
            found.push(tiers.collect::<Vec<_>>());
        }
        assert_eq!(
            found[0],
            [
                (0, Tier::Precise, 1),
                (1, Tier::Coarse, 1),
                (2, Tier::Precise, 1)
            ]
        );
        assert!(found.iter().all(|tiers| *tiers == found[0]), "{found:?}");
    }

    #[test]
    fn what_is_older_than_the_second_is_forgotten_and_a_joined_track_goes_on() {
        let at = DVec2::new(0.1, 0.1);
        let history = |times: std::ops::Range<u32>| {
            let mut history = History::default();
            for k in times {
                history.take(glimpse(f64::from(k) / 16.0, Tier::Coarse, at), || {
                    chip(k as u8)
                });
            }
            history
        };
        let long = history(0..40);
        assert_eq!(long.steps.len(), STEPS + 1);
        assert!(long.sequence(2.0 + 38.0 / 16.0, 1.0, true).is_none());
        let mut old = history(0..8);
        old.join(history(11..14));
        let found = old.sequence(14.0 / 16.0, 1.0, true).unwrap();
        let steps: Vec<i64> = found
            .steps
            .iter()
            .flatten()
            .map(|step| step.number)
            .collect();
        assert_eq!(steps, [0, 1, 2, 3, 4, 5, 6, 7, 11, 12, 13]);
        assert!(history(0..2).sequence(1.0 / 16.0, 1.0, true).is_none());
    }

    #[test]
    fn a_recognition_names_its_most_probable_class() {
        let found = Recognition {
            probabilities: [0.2, 0.5, 0.1, 0.05, 0.05, 0.1],
            t_s: 1.0,
        };
        assert_eq!((found.class(), found.p_uav()), (TrackClass::Bird, 0.2));
    }
}
