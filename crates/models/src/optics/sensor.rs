//! Image formation: from a rendered frame of scene luminance to the 8-bit frame of a camera.
//!
//! Chain: motion of the image while its rows are exposed -> blur by the optics and the air
//! (Gaussian) -> glare of the sun, lasers and lamps -> image-plane illuminance
//! E = pi L tau / (4 N^2), less towards the corners -> photoelectrons of the pixel's colour filter,
//! times its sensitivity -> dark current and offset -> shot and read noise -> full-well clip -> 12-bit conversion above a black level ->
//! colours interpolated from the mosaic -> white balance -> 8-bit code.
//!
//! Assumptions: object at infinity; the colour filters are the channels of linear sRGB, and their
//! light is counted as photons of 555 nm ([`PHOTONS_PER_LUX_S_M2`]), so that a white scene gives them
//! equal signals; shot noise is Gaussian of variance equal to the mean, which is good above some 10
//! electrons; noise ends at 4.66 sigma; the fixed pattern is white.
//!
//! Noise is a hash of (seed, pixel, channel), so a frame does not depend on how its rows are split
//! over threads. A window has the pixels and the noise of its place in the full frame, except in a
//! margin of the blur's radius and a pixel for the mosaic: there the window goes on as it ends.

use std::ops::Range;
use std::sync::{Arc, LazyLock};

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::exposure::Exposure;
use super::glare::SunGlare;
use super::mosaic::{self, Mosaic, Neighbours};
use super::motion::{ImageMotion, Shutter, Smear};
use super::noise;
use super::pattern::FixedPattern;
use super::stray::light::StrayLight;

/// Photons per second and square metre in one lux of 555 nm light: (1/683 W/lm) / (h c / lambda).
pub const PHOTONS_PER_LUX_S_M2: f64 = 555e-9 / (683.0 * 6.626_070_15e-34 * 299_792_458.0);

/// Blur below this is left out [px].
const MIN_BLUR_SIGMA_PX: f64 = 0.15;
/// Blur above this is refused: the kernel would no longer be small [px].
const MAX_BLUR_SIGMA_PX: f64 = 16.0;
/// Codes of the internal analogue-to-digital conversion, 12 bits.
const CODES: usize = 4096;
/// Largest finite half float, to which brighter input is limited [kcd/m^2].
const MAX_LUMINANCE_KCD_M2: f32 = 65504.0;
/// The code of no light: noise below it is not cut off.
const BLACK: usize = 64;
/// Glare below this share of the white level is left out.
const MIN_GLARE: f64 = 0.005;

/// How the linear signal becomes the 8-bit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// The sRGB transfer curve (IEC 61966-2-1), as cameras deliver.
    Srgb,
    /// Proportional to the signal, for radiometry.
    Linear,
}

/// A camera's lens and sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorParams {
    /// Focal length over aperture diameter.
    pub f_number: f64,
    /// Side of a square pixel [m].
    pub pixel_pitch_m: f64,
    /// Transmission of the lens and filters, 0 to 1.
    pub transmission: f64,
    /// Photoelectrons per photon, 0 to 1.
    pub quantum_efficiency: f64,
    /// Electrons a pixel holds.
    pub full_well_e: f64,
    /// Read noise, standard deviation [electrons].
    pub read_noise_e: f64,
    /// Electrons that gather in the dark, a second.
    pub dark_current_eps: f64,
    /// Standard deviation of the pixels' offsets [electrons].
    pub dsnu_e: f64,
    /// Standard deviation of the pixels' sensitivities, of their mean.
    pub prnu: f64,
    /// Key of the pattern of those two.
    pub pattern_key: u64,
    /// Width and height of the whole sensor [px].
    pub size_px: [u32; 2],
    /// Focal length over pixel pitch, for the natural loss cos^4 towards the corners [px].
    pub focal_px: f64,
    /// Share of the light that the lens's mounts take in the corners; it grows with the square of
    /// the distance from the centre.
    pub vignetting: f64,
    /// Colour filters.
    pub mosaic: Mosaic,
    /// When the rows are exposed.
    pub shutter: Shutter,
    /// Whether what moves during the exposure is smeared.
    pub motion_blur: bool,
    /// Strength of the sun's veiling glare, see [`SunGlare`].
    pub glare: f64,
    /// Standard deviation of the blur by diffraction and turbulence [px]; under 0.15 is none.
    pub blur_sigma_px: f64,
    /// Gains of the red, green and blue code, 1 or more.
    pub white_balance: [f64; 3],
    /// Encoding of the 8-bit code.
    pub transfer: Transfer,
}

impl SensorParams {
    /// Photoelectrons per pixel for 1 kcd/m^2 of scene luminance in a second.
    pub fn electrons_per_kcd_m2_s(&self) -> f64 {
        let lux_per_kcd_m2 =
            1000.0 * std::f64::consts::PI * self.transmission / (4.0 * self.f_number.powi(2));
        lux_per_kcd_m2
            * PHOTONS_PER_LUX_S_M2
            * self.pixel_pitch_m.powi(2)
            * self.quantum_efficiency
            * self.mosaic.filters()
    }

    /// Luminance times exposure time that fills the well [kcd s/m^2].
    pub fn saturation_kcd_s_m2(&self) -> f64 {
        self.full_well_e / self.electrons_per_kcd_m2_s()
    }
}

/// A sensor or a frame that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SensorError {
    /// A parameter out of its range.
    #[error("sensor parameter {name} is {value}: it must be {range}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Which values it may take.
        range: &'static str,
    },
    /// A buffer that does not fit the frame.
    #[error("{what} has {found} bytes where the {width} x {height} px frame needs {needed}")]
    Buffer {
        /// Name of the buffer.
        what: &'static str,
        /// Its length [elements].
        found: usize,
        /// The length it should have.
        needed: usize,
        /// Frame width [px].
        width: usize,
        /// Frame height [px].
        height: usize,
    },
    /// Rows that the frame does not have.
    #[error("rows {start}..{end} are not rows of a frame {height} px high")]
    Rows {
        /// First row.
        start: usize,
        /// Row after the last.
        end: usize,
        /// Frame height [px].
        height: usize,
    },
}

/// A rendered frame, or the window of one that is read out.
#[derive(Clone, Copy, Debug)]
pub struct RenderedFrame<'a> {
    /// Rows of RGBA half floats, little-endian, without padding: scene luminance of the channels
    /// of linear sRGB [kcd/m^2]; A is not read.
    pub rgba16f: &'a [u8],
    /// Width [px].
    pub width: usize,
    /// Height [px].
    pub height: usize,
    /// Column and row of the frame's first pixel on the whole sensor [px].
    pub origin_px: [u32; 2],
    /// How it is exposed.
    pub conditions: &'a Conditions,
}

/// How a frame is exposed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Conditions {
    /// Exposure time and gain.
    pub exposure: Exposure,
    /// What the image does meanwhile.
    pub motion: ImageMotion,
    /// The sun, where it shines on the lens.
    pub sun: Option<SunGlare>,
    /// Lasers and lamps, where any is on.
    pub stray: Option<Arc<StrayLight>>,
}

/// Rows of one frame's even and odd columns for each of its channels.
type HalfRows = [Vec<f32>; 6];

/// Row buffers, kept from frame to frame by each thread.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// How the rows move; behind a rolling shutter, the row that was decoded last.
    smear: Option<Smear>,
    half: Vec<f16>,
    rgba: Vec<f32>,
    /// A decoded row, continued at both ends.
    padded: HalfRows,
    /// Horizontally blurred rows: row `y` lies at `y` modulo the kernel's length.
    ring: Vec<HalfRows>,
    mean: Vec<f32>,
    noise: Vec<f32>,
    glare: Vec<f32>,
    /// The fixed pattern of a sensor that has none.
    plain: Vec<i8>,
    /// Raw codes with a column more at either end: of the three channels, or of the mosaic's rows,
    /// row `y` at `y` modulo 3.
    raw: [Vec<u16>; 3],
    neighbours: Neighbours,
}

/// The 8-bit code of each 12-bit code, proportional and by the sRGB curve.
static CURVES: LazyLock<[[u8; CODES]; 2]> = LazyLock::new(|| {
    let curve = |encode: fn(f64) -> f64| {
        std::array::from_fn(|code| (255.0 * encode(code as f64 / (CODES - 1) as f64)).round() as u8)
    };
    [
        curve(|linear| linear),
        curve(|linear| {
            if linear <= 0.003_130_8 {
                12.92 * linear
            } else {
                1.055 * linear.powf(1.0 / 2.4) - 0.055
            }
        }),
    ]
});

/// The 8-bit codes of a camera's channels: black level, white balance, then its curve.
fn channel_codes(params: &SensorParams) -> [[u8; CODES]; 3] {
    let curve = match params.transfer {
        Transfer::Linear => &CURVES[0],
        Transfer::Srgb => &CURVES[1],
    };
    let most = (CODES - 1) as f64;
    let scale = most / (CODES - 1 - BLACK) as f64;
    params.white_balance.map(|gain| {
        std::array::from_fn(|code| {
            let light = (code as f64 - BLACK as f64) * scale * gain;
            curve[light.round().clamp(0.0, most) as usize]
        })
    })
}

/// The half kernel of a Gaussian blur: the weight of the middle, then of each neighbour outwards.
pub(super) fn half_kernel(sigma_px: f64) -> Vec<f64> {
    if sigma_px < MIN_BLUR_SIGMA_PX {
        return vec![1.0];
    }
    let variance = sigma_px * sigma_px;
    if sigma_px < 0.6 {
        // Samples of so narrow a Gaussian have the wrong variance: three taps with the right one.
        return vec![1.0 - variance, 0.5 * variance];
    }
    let radius = (3.0 * sigma_px).ceil() as usize;
    let mut taps: Vec<f64> = (0..=radius)
        .map(|k| (-0.5 * (k * k) as f64 / variance).exp())
        .collect();
    let sum = 2.0 * taps.iter().sum::<f64>() - taps[0];
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}

/// `out[i]` = the sum at `i` of the sources 0 to 2 radius, weighted by the symmetric half kernel.
/// Blocks of a fixed size keep their sums in registers while the sources go by.
fn weigh<'a>(taps: &[f32], source: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
    const BLOCK: usize = 32;
    let radius = taps.len() - 1;
    let mut start = 0;
    let mut blocks = out.chunks_exact_mut(BLOCK);
    for block in &mut blocks {
        let at = |k: usize| source(k)[start..].first_chunk::<BLOCK>();
        let mut sum = [0.0; BLOCK];
        if let Some(middle) = at(radius) {
            for (sum, middle) in sum.iter_mut().zip(middle) {
                *sum = taps[0] * middle;
            }
        }
        for (k, tap) in taps.iter().enumerate().skip(1) {
            if let (Some(before), Some(after)) = (at(radius - k), at(radius + k)) {
                for (sum, (before, after)) in sum.iter_mut().zip(before.iter().zip(after)) {
                    *sum += tap * (before + after);
                }
            }
        }
        block.copy_from_slice(&sum);
        start += BLOCK;
    }
    for (i, out) in blocks.into_remainder().iter_mut().enumerate() {
        let at = |k: usize| source(k)[start + i];
        let sides = (1..=radius).map(|k| taps[k] * (at(radius - k) + at(radius + k)));
        *out = sides.fold(taps[0] * at(radius), |sum, side| sum + side);
    }
}

/// A camera ready to expose frames.
#[derive(Clone, Debug)]
pub struct Sensor {
    params: SensorParams,
    taps: Vec<f32>,
    /// The 8-bit code of each 12-bit code, for each channel.
    codes: Arc<[[u8; CODES]; 3]>,
    pattern: Option<Arc<FixedPattern>>,
}

/// What a frame's light becomes.
struct Gains {
    e_per_kcd_m2: f32,
    dark_e: f32,
    read_variance_e2: f32,
    codes_per_e: f32,
    /// The sun's glare and its illuminance [klx] for each channel, where it counts.
    glare: Option<(SunGlare, [f32; 3])>,
}

impl Sensor {
    /// The camera of `params`. Its fixed pattern is drawn once: clones share it.
    pub fn new(params: &SensorParams) -> Result<Self, SensorError> {
        let positive = "above 0 and finite";
        let share = "above 0 and at most 1";
        for (name, value, range, most) in [
            ("f_number", params.f_number, positive, f64::MAX),
            ("pixel_pitch_m", params.pixel_pitch_m, positive, f64::MAX),
            ("transmission", params.transmission, share, 1.0),
            ("quantum_efficiency", params.quantum_efficiency, share, 1.0),
            ("full_well_e", params.full_well_e, positive, f64::MAX),
            ("focal_px", params.focal_px, positive, f64::MAX),
        ] {
            if !(value > 0.0 && value <= most) {
                return Err(SensorError::Parameter { name, value, range });
            }
        }
        let not_negative = "0 or more and finite";
        let blur = MAX_BLUR_SIGMA_PX;
        for (name, value, range, most) in [
            ("read_noise_e", params.read_noise_e, not_negative, f64::MAX),
            (
                "dark_current_eps",
                params.dark_current_eps,
                not_negative,
                f64::MAX,
            ),
            ("dsnu_e", params.dsnu_e, not_negative, f64::MAX),
            ("prnu", params.prnu, "0 to 0.2", 0.2),
            ("vignetting", params.vignetting, "0 to 1", 1.0),
            ("glare", params.glare, not_negative, f64::MAX),
            ("blur_sigma_px", params.blur_sigma_px, "0 to 16 px", blur),
        ] {
            if !(value >= 0.0 && value <= most) {
                return Err(SensorError::Parameter { name, value, range });
            }
        }
        let taps = half_kernel(params.blur_sigma_px);
        let patterned = params.dsnu_e > 0.0 || params.prnu > 0.0;
        let [width, height] = params.size_px.map(|n| n as usize);
        Ok(Self {
            taps: taps.iter().map(|tap| *tap as f32).collect(),
            codes: Arc::new(channel_codes(params)),
            pattern: patterned
                .then(|| Arc::new(FixedPattern::new(width, height, params.pattern_key))),
            params: *params,
        })
    }

    /// What it was made of.
    pub fn params(&self) -> &SensorParams {
        &self.params
    }

    /// 12-bit codes an electron: the system gain K of EMVA 1288.
    pub fn codes_per_e(&self, exposure: &Exposure) -> f64 {
        (CODES - 1 - BLACK) as f64 / self.params.full_well_e * exposure.gain
    }

    /// Exposes `rows` of `frame` into `rgb8`, those rows of R, G, B codes. The noise is that of
    /// `seed`: draw one for each frame, and give it to every thread that takes a part of the rows.
    pub fn expose(
        &self,
        frame: &RenderedFrame<'_>,
        rows: Range<usize>,
        seed: u64,
        scratch: &mut Scratch,
        rgb8: &mut [u8],
    ) -> Result<(), SensorError> {
        let width = frame.width;
        frame.check(&rows, 3 * width * rows.len(), rgb8.len())?;
        if rgb8.is_empty() {
            return Ok(());
        }
        let gains = self.gains(frame);
        let mosaic = self.params.mosaic == Mosaic::Rggb;
        let last = frame.height - 1;
        let first = if mosaic {
            rows.start.saturating_sub(1)
        } else {
            rows.start
        };
        let mut next = first;
        for (y, out) in rows.zip(rgb8.chunks_exact_mut(3 * width)) {
            let wanted = if mosaic { (y + 1).min(last) } else { y };
            for row in next..=wanted {
                self.raw_row(frame, &gains, row, row == first, seed, scratch);
            }
            next = wanted + 1;
            let Scratch {
                raw, neighbours, ..
            } = &mut *scratch;
            if mosaic {
                // Beyond its border the mosaic is mirrored, which keeps its colours.
                let above = if y == 0 { 1.min(last) } else { y - 1 };
                let below = if y == last {
                    last.saturating_sub(1)
                } else {
                    y + 1
                };
                let [x0, y0] = frame.origin_px.map(|n| n as usize);
                let rows = [above, y, below].map(|row| &raw[row % 3][..]);
                mosaic::interpolate(rows, x0, y0 + y, &self.codes, neighbours, out);
            } else {
                let mono = self.params.mosaic == Mosaic::Mono;
                for channel in 0..3 {
                    let raw = &raw[if mono { 0 } else { channel }];
                    let codes = &self.codes[channel];
                    for (out, code) in out.iter_mut().skip(channel).step_by(3).zip(&raw[1..]) {
                        *out = codes[*code as usize % CODES];
                    }
                }
            }
        }
        Ok(())
    }

    /// The 12-bit codes of a whole frame before any of it is interpolated or balanced: one a pixel
    /// behind a mosaic and without filters, else three.
    pub fn raw(
        &self,
        frame: &RenderedFrame<'_>,
        seed: u64,
        scratch: &mut Scratch,
    ) -> Result<Vec<u16>, SensorError> {
        let mosaic = self.params.mosaic == Mosaic::Rggb;
        frame.check(&(0..frame.height), 0, 0)?;
        let gains = self.gains(frame);
        let mut codes = Vec::new();
        for y in 0..frame.height {
            self.raw_row(frame, &gains, y, y == 0, seed, scratch);
            let raw = &scratch.raw;
            if mosaic {
                codes.extend_from_slice(&raw[y % 3][1..=frame.width]);
            } else if self.params.mosaic == Mosaic::Mono {
                codes.extend_from_slice(&raw[0][1..=frame.width]);
            } else {
                codes.extend((1..=frame.width).flat_map(|x| [raw[0][x], raw[1][x], raw[2][x]]));
            }
        }
        Ok(codes)
    }

    /// What the light of a frame becomes.
    fn gains(&self, frame: &RenderedFrame<'_>) -> Gains {
        let params = &self.params;
        let exposure = &frame.conditions.exposure;
        let white_kcd_m2 = params.saturation_kcd_s_m2() / (exposure.time_s * exposure.gain);
        let [width, height] = params.size_px.map(f64::from);
        let half_field_rad = (0.5 * width.hypot(height) / params.focal_px).atan();
        let counts = |sun: &SunGlare| {
            let most = sun.most_kcd_m2(params.glare, half_field_rad);
            most > MIN_GLARE * white_kcd_m2
        };
        Gains {
            e_per_kcd_m2: (params.electrons_per_kcd_m2_s() * exposure.time_s) as f32,
            dark_e: (params.dark_current_eps * exposure.time_s) as f32,
            read_variance_e2: params.read_noise_e.powi(2) as f32,
            codes_per_e: self.codes_per_e(exposure) as f32,
            glare: (frame.conditions.sun.filter(counts))
                .map(|sun| (sun, self.filtered(sun.sun_klx.map(|klx| klx as f32)))),
        }
    }

    /// Light as the pixels count it, channel by channel: without filters the first has the mean of all.
    fn filtered(&self, [r, g, b]: [f32; 3]) -> [f32; 3] {
        match self.params.mosaic {
            Mosaic::None | Mosaic::Rggb => [r, g, b],
            Mosaic::Mono => [(r + g + b) / 3.0; 3],
        }
    }

    /// The raw codes of row `y`, into `scratch.raw`. Rows must be asked for in order; `first` starts
    /// a new run of them.
    fn raw_row(
        &self,
        frame: &RenderedFrame<'_>,
        gains: &Gains,
        y: usize,
        first: bool,
        seed: u64,
        scratch: &mut Scratch,
    ) {
        self.blur_rows(frame, y, first, scratch);
        let [x0, y0] = frame.origin_px.map(|n| n as usize);
        let length = 2 * self.taps.len() - 1;
        let (radius, last) = (self.taps.len() - 1, frame.height - 1);
        for parity in 0..frame.width.min(2) {
            let count = (frame.width - parity).div_ceil(2);
            let (x, row) = (x0 + parity, y0 + y);
            for channel in self.params.mosaic.channels(x, row) {
                let half = 2 * channel + parity;
                let Scratch {
                    ring,
                    mean,
                    noise,
                    glare,
                    plain,
                    raw,
                    ..
                } = &mut *scratch;
                mean.resize(count, 0.0);
                // Beyond the first and the last row the frame goes on as they are.
                let source =
                    |k: usize| &ring[(y + k).saturating_sub(radius).min(last) % length][half][..];
                weigh(&self.taps, source, mean);
                if let Some((sun, klx)) = &gains.glare {
                    glare.resize(count, 0.0);
                    sun.half_row(self.params.glare, x, row, glare);
                    for (mean, glare) in mean.iter_mut().zip(&*glare) {
                        *mean += klx[channel] * glare;
                    }
                }
                if let Some(stray) = &frame.conditions.stray {
                    glare.resize(count, 0.0);
                    stray.half_row(channel, x, row, glare);
                    for (mean, light) in mean.iter_mut().zip(&*glare) {
                        *mean += light;
                    }
                }
                noise.resize(count, 0.0);
                let number = 3 * (2 * row + x % 2) + channel;
                noise::row(noise::key(seed, number as u64), x / 2, noise);
                plain.resize(count, 0);
                let pattern = self.pattern.as_ref().and_then(|p| p.half_row(x, row));
                let pattern = pattern.unwrap_or([&plain[..], &plain[..]]);
                self.convert(gains, x, row, mean, pattern, noise);
                let place = match self.params.mosaic {
                    Mosaic::Rggb => y % 3,
                    Mosaic::None | Mosaic::Mono => channel,
                };
                raw[place].resize(frame.width + 2, 0);
                let columns = raw[place][1 + parity..].chunks_mut(2);
                for (raw, code) in columns.zip(&*noise) {
                    // Adding 2^23 rounded it to an integer in the low bits of the mantissa.
                    raw[0] = code.to_bits() as u16 % CODES as u16;
                }
            }
        }
        // A mosaic is mirrored at its border.
        let (raw, width) = (&mut scratch.raw[y % 3], frame.width);
        if self.params.mosaic == Mosaic::Rggb {
            (raw[0], raw[width + 1]) = (raw[2.min(width)], raw[(width - 1).max(1)]);
        }
    }

    /// Turns the mean luminance of every second pixel from (`x`, `y`) of the whole sensor on into
    /// codes plus 2^23, which take the place of the noise.
    fn convert(
        &self,
        gains: &Gains,
        x: usize,
        y: usize,
        mean: &[f32],
        [sensitivity, offset]: [&[i8]; 2],
        noise: &mut [f32],
    ) {
        let params = &self.params;
        let [width, height] = params.size_px.map(|n| n as f32);
        let inverse = (1.0 / params.focal_px) as f32;
        let first = (x as f32 + 0.5 - 0.5 * width) * inverse;
        let down = (y as f32 + 0.5 - 0.5 * height) * inverse;
        let (step, down_2) = (2.0 * inverse, down * down);
        let corner_2 = 0.25 * (width * width + height * height) * inverse * inverse;
        let loss = params.vignetting as f32 / corner_2;
        let prnu = params.prnu as f32 * FixedPattern::UNIT;
        let dsnu_e = params.dsnu_e as f32 * FixedPattern::UNIT;
        let limit = (CODES - 1) as f32;
        let pattern = sensitivity.iter().zip(offset);
        for (i, ((noise, mean), (sensitivity, offset))) in
            noise.iter_mut().zip(mean).zip(pattern).enumerate()
        {
            let right = first + i as f32 * step;
            let tan_2 = right * right + down_2;
            // cos^4 of the angle from the axis, and the mounts.
            let lens = (1.0 - loss * tan_2) / ((1.0 + tan_2) * (1.0 + tan_2));
            let sensitivity = lens * (1.0 + prnu * f32::from(*sensitivity)) * gains.e_per_kcd_m2;
            let shot_e = mean * sensitivity + gains.dark_e;
            let shot_e = if shot_e > 0.0 { shot_e } else { 0.0 };
            let sigma_e = (shot_e + gains.read_variance_e2).sqrt();
            let signal_e = shot_e + dsnu_e * f32::from(*offset) + sigma_e * *noise;
            let code = signal_e * gains.codes_per_e + BLACK as f32;
            let code = if code > 0.0 { code } else { 0.0 };
            let code = if code < limit { code } else { limit };
            *noise = code + 8_388_608.0;
        }
    }

    /// Blurs the rows that row `y` needs along themselves, into the ring.
    fn blur_rows(&self, frame: &RenderedFrame<'_>, y: usize, first: bool, scratch: &mut Scratch) {
        let radius = self.taps.len() - 1;
        let length = 2 * radius + 1;
        scratch.ring.resize_with(length, HalfRows::default);
        let missing = if first {
            y.saturating_sub(radius)
        } else {
            y + radius
        };
        let rolling = self.params.shutter != Shutter::Global;
        for row in missing..=(y + radius).min(frame.height - 1) {
            if rolling || (first && row == missing) {
                scratch.smear = self.smear(frame, row);
            }
            self.decode(frame, row, scratch);
            let Scratch { padded, ring, .. } = &mut *scratch;
            let pad = Self::pad(radius);
            for (half, out) in ring[row % length].iter_mut().enumerate() {
                let (channel, parity) = (half / 2, half % 2);
                let x = frame.origin_px[0] as usize + parity;
                let counted = |y| self.params.mosaic.channels(x, y).contains(&channel);
                if !counted(0) && !counted(1) {
                    continue;
                }
                out.resize((frame.width - parity.min(frame.width)).div_ceil(2), 0.0);
                weigh(
                    &self.taps,
                    |k| {
                        // Column 2 i + parity + k - radius, among those of its own parity.
                        let column = parity + k + 2 * pad - radius;
                        let start = (column - column % 2) / 2;
                        &padded[2 * channel + column % 2][start..]
                    },
                    out,
                );
            }
        }
    }

    /// Columns of either parity by which a decoded row is continued at its ends.
    fn pad(radius: usize) -> usize {
        radius / 2 + 2
    }

    /// Decodes row `y` as its exposure saw it, into `scratch.padded`.
    fn decode(&self, frame: &RenderedFrame<'_>, y: usize, scratch: &mut Scratch) {
        let width = frame.width;
        let Scratch {
            smear,
            half,
            rgba,
            padded,
            ..
        } = scratch;
        rgba.resize(4 * width, 0.0);
        let motion = smear.as_ref();
        match motion.and_then(|smear| smear.row(y, width, frame.origin_px)) {
            None => frame.decode(y, half, rgba),
            Some(motion) => motion.gather(
                y,
                frame.height,
                |y, row| {
                    row.resize(4 * width, 0.0);
                    frame.decode(y, half, row);
                },
                rgba,
            ),
        }
        if self.params.mosaic == Mosaic::Mono {
            for pixel in rgba.as_chunks_mut::<4>().0 {
                [pixel[0], ..] = self.filtered([pixel[0], pixel[1], pixel[2]]);
            }
        }
        let pad = Self::pad(self.taps.len() - 1);
        // A comparison with a NaN is false: it becomes 0.
        let limited = |value: f32| {
            let value = if value > 0.0 { value } else { 0.0 };
            if value < MAX_LUMINANCE_KCD_M2 {
                value
            } else {
                MAX_LUMINANCE_KCD_M2
            }
        };
        for (channel, halves) in padded.chunks_exact_mut(2).enumerate() {
            for (parity, half) in halves.iter_mut().enumerate() {
                half.resize((width - parity.min(width)).div_ceil(2) + 2 * pad, 0.0);
            }
            let [even, odd] = halves else { continue };
            let columns = even[pad..].iter_mut().zip(&mut odd[pad..]);
            let (pairs, rest) = rgba.as_chunks::<8>();
            for ((even, odd), pair) in columns.zip(pairs) {
                *even = limited(pair[channel]);
                *odd = limited(pair[4 + channel]);
            }
            if let Some(last) = rest.get(channel) {
                even[pad + width / 2] = limited(*last);
            }
        }
        for channel in 0..3 {
            let left = padded[2 * channel][pad];
            let last = width - 1;
            let right = padded[2 * channel + last % 2][pad + last / 2];
            for half in &mut padded[2 * channel..2 * channel + 2] {
                let end = half.len() - pad;
                half[..pad].fill(left);
                half[end..].fill(right);
            }
        }
    }

    /// How long what moves is smeared by an exposure [s].
    pub fn smeared_s(&self, exposure: &Exposure) -> f64 {
        if self.params.motion_blur {
            exposure.time_s
        } else {
            0.0
        }
    }

    /// How row `y` of a frame moves while it is exposed; none where nothing does.
    fn smear(&self, frame: &RenderedFrame<'_>, y: usize) -> Option<Smear> {
        let params = &self.params;
        let smeared_s = self.smeared_s(&frame.conditions.exposure);
        let delay_s = match params.shutter {
            Shutter::Global => 0.0,
            Shutter::Rolling(line_s) => {
                let row = f64::from(frame.origin_px[1]) + y as f64;
                line_s * (row + 0.5 - 0.5 * f64::from(params.size_px[1]))
            }
        };
        frame.conditions.motion.smear(smeared_s, delay_s)
    }
}

impl RenderedFrame<'_> {
    /// Checks the frame, the rows asked of it, and the output's length against the one needed.
    fn check(&self, rows: &Range<usize>, needed: usize, found: usize) -> Result<(), SensorError> {
        let (width, height) = (self.width, self.height);
        if rows.start > rows.end || rows.end > height {
            return Err(SensorError::Rows {
                start: rows.start,
                end: rows.end,
                height,
            });
        }
        for (what, found, needed) in [
            ("the rendered frame", self.rgba16f.len(), 8 * width * height),
            ("the output", found, needed),
        ] {
            if found != needed {
                return Err(SensorError::Buffer {
                    what,
                    found,
                    needed,
                    width,
                    height,
                });
            }
        }
        Ok(())
    }

    /// Row `y` as single floats.
    fn decode(&self, y: usize, half: &mut Vec<f16>, rgba: &mut [f32]) {
        let line = 8 * self.width;
        let (values, _) = self.rgba16f[line * y..line * (y + 1)].as_chunks::<2>();
        half.clear();
        half.extend(values.iter().map(|bytes| f16::from_le_bytes(*bytes)));
        half.convert_to_f32_slice(rgba);
    }
}

#[cfg(test)]
mod tests;
