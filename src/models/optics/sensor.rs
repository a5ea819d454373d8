//! Image formation: from a rendered frame of scene luminance to the 8-bit frame of a camera.
//!
//! Chain: blur by the optics and the air (Gaussian) -> image-plane illuminance E = pi L tau / (4 N^2)
//! -> photoelectrons -> shot and read noise -> full-well clip -> 12-bit conversion -> 8-bit code.
//!
//! Assumptions: object at infinity, no vignetting; each channel of linear sRGB is a luminance and
//! its light is counted as photons of 555 nm ([`PHOTONS_PER_LUX_S_M2`]), so that a white scene gives
//! its three channels equal signals; all three are sampled at each pixel (no colour mosaic); shot
//! noise is Gaussian of variance equal to the mean, which is good above some 10 electrons; noise
//! ends at 4.66 sigma; no dark current, fixed pattern or black offset (negative codes clip to 0).
//!
//! Noise is a hash of (seed, pixel, channel), so a frame does not depend on how its rows are split
//! over threads, nor a pixel's noise on the window that is read out.

use std::ops::Range;
use std::sync::{Arc, LazyLock};

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::exposure::Exposure;

/// Photons per second and square metre in one lux of 555 nm light: (1/683 W/lm) / (h c / lambda).
pub const PHOTONS_PER_LUX_S_M2: f64 = 555e-9 / (683.0 * 6.626_070_15e-34 * 299_792_458.0);

/// Blur below this is left out [px].
const MIN_BLUR_SIGMA_PX: f64 = 0.15;
/// Blur above this is refused: the kernel would no longer be small [px].
const MAX_BLUR_SIGMA_PX: f64 = 16.0;
/// Codes of the internal analogue-to-digital conversion, 12 bits.
const CODES: usize = 4096;
/// Entries of the table of normal quantiles.
const QUANTILES: usize = 1024;
/// Largest finite half float, to which brighter input is limited [kcd/m^2].
const MAX_LUMINANCE_KCD_M2: f32 = 65504.0;
/// The step of a Weyl sequence of 64 bits, 2^64 / golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

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
        lux_per_kcd_m2 * PHOTONS_PER_LUX_S_M2 * self.pixel_pitch_m.powi(2) * self.quantum_efficiency
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
}

/// Row buffers, kept from frame to frame by each thread.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    half: Vec<f16>,
    rgba: Vec<f32>,
    padded: Vec<f32>,
    /// Horizontally blurred rows: row `y` lies at `y` modulo the kernel's length.
    ring: Vec<Vec<f32>>,
    mean_e: Vec<f32>,
    noise: Vec<f32>,
}

/// Normal quantiles at the middles of 1024 equal steps of probability, scaled so that the sum of
/// two independent picks has unit variance.
static NOISE: LazyLock<[f32; QUANTILES]> = LazyLock::new(|| {
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let mut quantiles = [0.0_f64; QUANTILES];
    // Walk the cumulative distribution down from 1/2 by the trapezoidal rule; the upper half is
    // the mirror image.
    let step = 1e-3;
    let (mut x, mut below) = (0.0, 0.5);
    for i in (0..QUANTILES / 2).rev() {
        let wanted = (i as f64 + 0.5) / QUANTILES as f64;
        let slice = |x: f64| 0.5 * step * (density(x) + density(x - step));
        while below - slice(x) > wanted {
            below -= slice(x);
            x -= step;
        }
        quantiles[i] = x - step * (below - wanted) / slice(x);
        quantiles[QUANTILES - 1 - i] = -quantiles[i];
    }
    let variance = quantiles.iter().map(|q| q * q).sum::<f64>() / QUANTILES as f64;
    quantiles.map(|q| (q / (2.0 * variance).sqrt()) as f32)
});

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

/// The 8-bit codes of a camera's channels: white balance, then its curve.
fn channel_codes(params: &SensorParams) -> [[u8; CODES]; 3] {
    let curve = match params.transfer {
        Transfer::Linear => &CURVES[0],
        Transfer::Srgb => &CURVES[1],
    };
    params.white_balance.map(|gain| {
        let most = (CODES - 1) as f64;
        std::array::from_fn(|code| curve[(code as f64 * gain).round().clamp(0.0, most) as usize])
    })
}

/// A bijective hash of 64 bits (the finaliser of SplitMix64, Steele et al. 2014).
fn hash(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The half kernel of a Gaussian blur: the weight of the middle, then of each neighbour outwards.
fn half_kernel(sigma_px: f64) -> Vec<f64> {
    if sigma_px < MIN_BLUR_SIGMA_PX {
        return vec![1.0];
    }
    let variance = sigma_px * sigma_px;
    if sigma_px < 0.6 {
        // Samples of so narrow a Gaussian have the wrong variance: three taps with the right one.
        return vec![1.0 - variance, 0.5 * variance];
    }
    let radius = (3.5 * sigma_px).ceil() as usize;
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
    taps: Vec<f32>,
    params: SensorParams,
    /// The 8-bit code of each 12-bit code, for each channel.
    codes: Arc<[[u8; CODES]; 3]>,
    read_variance_e2: f32,
}

impl Sensor {
    /// The camera of `params`; cheap enough to rebuild when the exposure or the blur changes.
    pub fn new(params: &SensorParams) -> Result<Self, SensorError> {
        let positive = "above 0 and finite";
        let share = "above 0 and at most 1";
        for (name, value, range, most) in [
            ("f_number", params.f_number, positive, f64::MAX),
            ("pixel_pitch_m", params.pixel_pitch_m, positive, f64::MAX),
            ("transmission", params.transmission, share, 1.0),
            ("quantum_efficiency", params.quantum_efficiency, share, 1.0),
            ("full_well_e", params.full_well_e, positive, f64::MAX),
        ] {
            if !(value > 0.0 && value <= most) {
                return Err(SensorError::Parameter { name, value, range });
            }
        }
        for (name, value, range, most) in [
            (
                "read_noise_e",
                params.read_noise_e,
                "0 or more and finite",
                f64::MAX,
            ),
            (
                "blur_sigma_px",
                params.blur_sigma_px,
                "0 to 16 px",
                MAX_BLUR_SIGMA_PX,
            ),
        ] {
            if !(value >= 0.0 && value <= most) {
                return Err(SensorError::Parameter { name, value, range });
            }
        }
        let taps = half_kernel(params.blur_sigma_px);
        Ok(Self {
            taps: taps.iter().map(|tap| *tap as f32).collect(),
            read_variance_e2: params.read_noise_e.powi(2) as f32,
            codes: Arc::new(channel_codes(params)),
            params: *params,
        })
    }

    /// Luminance times exposure time that fills the well [kcd s/m^2].
    pub fn saturation_kcd_s_m2(&self) -> f64 {
        self.params.saturation_kcd_s_m2()
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
        let (width, height) = (frame.width, frame.height);
        if rows.start > rows.end || rows.end > height {
            return Err(SensorError::Rows {
                start: rows.start,
                end: rows.end,
                height,
            });
        }
        for (what, found, needed) in [
            (
                "the rendered frame",
                frame.rgba16f.len(),
                8 * width * height,
            ),
            ("the output", rgb8.len(), 3 * width * rows.len()),
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
        if rgb8.is_empty() {
            return Ok(());
        }
        scratch.noise.resize(3 * width, 0.0);
        let Exposure { time_s, gain } = frame.conditions.exposure;
        let e_per_kcd_m2 = (self.params.electrons_per_kcd_m2_s() * time_s) as f32;
        let codes_per_e = ((CODES - 1) as f64 / self.params.full_well_e * gain) as f32;
        let quantiles = &*NOISE;
        let first = rows.start;
        for (y, out) in rows.zip(rgb8.chunks_exact_mut(3 * width)) {
            self.mean_row(frame, y, y == first, scratch);
            let row_key = hash(seed ^ hash(u64::from(frame.origin_px[1]) + y as u64));
            let column = u64::from(frame.origin_px[0]);
            for (x, noise) in scratch.noise.chunks_exact_mut(3).enumerate() {
                let count = (column + x as u64 + 1).wrapping_mul(GOLDEN);
                // 60 of the 64 bits: for each channel two picks of ten bits.
                let bits = hash(row_key.wrapping_add(count));
                for (channel, noise) in noise.iter_mut().enumerate() {
                    let bits = (bits >> (4 + 20 * channel)) as usize;
                    *noise = quantiles[bits % QUANTILES] + quantiles[bits / QUANTILES % QUANTILES];
                }
            }
            let limit = (CODES - 1) as f32;
            // Apart from the table look-up, so that this part runs on vectors.
            for (noise, mean_e) in scratch.noise.iter_mut().zip(&scratch.mean_e) {
                let mean_e = mean_e * e_per_kcd_m2;
                let sigma_e = (mean_e + self.read_variance_e2).sqrt();
                let code = (mean_e + sigma_e * *noise) * codes_per_e;
                let code = if code > 0.0 { code } else { 0.0 };
                let code = if code < limit { code } else { limit };
                // Adding 2^23 rounds to an integer, left in the low bits of the mantissa.
                *noise = code + 8_388_608.0;
            }
            for (out, code) in out.chunks_exact_mut(3).zip(scratch.noise.chunks_exact(3)) {
                for (channel, (out, code)) in out.iter_mut().zip(code).enumerate() {
                    *out = self.codes[channel][code.to_bits() as usize % CODES];
                }
            }
        }
        Ok(())
    }

    /// Mean electrons of row `y`, into `scratch.mean_e`. Rows must be asked for in order; `first`
    /// starts a new run of them.
    fn mean_row(&self, frame: &RenderedFrame<'_>, y: usize, first: bool, scratch: &mut Scratch) {
        let radius = self.taps.len() - 1;
        let length = 2 * radius + 1;
        let last = frame.height - 1;
        scratch.ring.resize_with(length, Vec::new);
        let missing = if first {
            y.saturating_sub(radius)
        } else {
            y + radius
        };
        for row in missing..=(y + radius).min(last) {
            self.blur_row(frame, row, scratch);
        }
        let Scratch { ring, mean_e, .. } = scratch;
        mean_e.resize(3 * frame.width, 0.0);
        // Beyond the first and the last row the frame goes on as they are.
        let source = |k: usize| &*ring[(y + k).saturating_sub(radius).min(last) % length];
        weigh(&self.taps, source, mean_e);
    }

    /// Decodes row `y` and blurs it along the row, into the ring.
    fn blur_row(&self, frame: &RenderedFrame<'_>, y: usize, scratch: &mut Scratch) {
        let width = frame.width;
        let radius = self.taps.len() - 1;
        let Scratch {
            half,
            rgba,
            padded,
            ring,
            ..
        } = scratch;
        half.clear();
        let (values, _) = frame.rgba16f[8 * width * y..8 * width * (y + 1)].as_chunks::<2>();
        half.extend(values.iter().map(|bytes| f16::from_le_bytes(*bytes)));
        rgba.resize(4 * width, 0.0);
        half.convert_to_f32_slice(rgba);
        padded.resize(3 * (width + 2 * radius), 0.0);
        let middle = &mut padded[3 * radius..3 * (radius + width)];
        for (rgb, rgba) in middle.chunks_exact_mut(3).zip(rgba.chunks_exact(4)) {
            for (to, from) in rgb.iter_mut().zip(rgba) {
                // A comparison with a NaN is false: it becomes 0.
                let value = if *from > 0.0 { *from } else { 0.0 };
                *to = if value < MAX_LUMINANCE_KCD_M2 {
                    value
                } else {
                    MAX_LUMINANCE_KCD_M2
                };
            }
        }
        for x in 0..radius {
            padded.copy_within(3 * radius..3 * radius + 3, 3 * x);
            padded.copy_within(
                3 * (radius + width - 1)..3 * (radius + width),
                3 * (radius + width + x),
            );
        }
        let row = &mut ring[y % self.ring_length()];
        row.resize(3 * width, 0.0);
        weigh(&self.taps, |k| &padded[3 * k..], row);
    }

    /// Rows the vertical blur needs at once.
    fn ring_length(&self) -> usize {
        2 * self.taps.len() - 1
    }
}

#[cfg(test)]
mod tests;
