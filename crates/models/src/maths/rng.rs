//! Random streams, one per (seed, entity, purpose).
//!
//! A stream never depends on how often another one was drawn from, nor on the order systems run
//! in: that is what makes a run repeat for any thread count. ChaCha8 is used as a counter-based
//! generator; its key is filled from the triple by XXH3.

use glam::DVec3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use xxhash_rust::xxh3::xxh3_128_with_seed;

/// A deterministic random stream.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of `purpose` (a fixed label such as `"gust"`) of `entity` (a stable scenario
    /// index, never an ECS id) under the run's `seed`.
    pub fn new(seed: u64, entity: u64, purpose: &str) -> Self {
        let mut text = Vec::with_capacity(8 + purpose.len());
        text.extend_from_slice(&entity.to_le_bytes());
        text.extend_from_slice(purpose.as_bytes());
        let mut key = [0; 32];
        key[..16].copy_from_slice(&xxh3_128_with_seed(&text, seed).to_le_bytes());
        key[16..].copy_from_slice(&xxh3_128_with_seed(&text, !seed).to_le_bytes());
        Self(ChaCha8Rng::from_seed(key))
    }

    /// A uniform number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        // 53 bits fill a double's mantissa exactly.
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A uniform number in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// One of the items of `of`, which must not be empty; all are equally likely.
    pub fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[((self.uniform() * of.len() as f64) as usize).min(of.len() - 1)]
    }

    /// A standard normal number.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// A vector of three independent standard normal numbers.
    pub fn normal3(&mut self) -> DVec3 {
        let [x, y, z] = [(); 3].map(|()| self.normal());
        DVec3::new(x, y, z)
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A Poisson count of mean `lambda` (0 for a mean that is not positive): Knuth's product of
    /// uniform numbers up to a mean of 30, the normal approximation above. `rand_distr::Poisson`
    /// draws other numbers, which would change every recorded run.
    pub fn poisson(&mut self, lambda: f64) -> u64 {
        if lambda <= 0.0 {
            return 0;
        }
        if lambda > 30.0 {
            return (lambda + lambda.sqrt() * self.normal()).round().max(0.0) as u64;
        }
        let limit = (-lambda).exp();
        let mut count = 0;
        let mut product = self.uniform();
        while product > limit {
            count += 1;
            product *= self.uniform();
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ() {
        let draw = |seed, entity, purpose| Stream::new(seed, entity, purpose).bits();
        assert_eq!(draw(1, 2, "gust"), draw(1, 2, "gust"));
        assert_ne!(draw(1, 2, "gust"), draw(2, 2, "gust"));
        assert_ne!(draw(1, 2, "gust"), draw(1, 3, "gust"));
        assert_ne!(draw(1, 2, "gust"), draw(1, 2, "jitter"));
    }

    #[test]
    fn moments_are_right() {
        let mut stream = Stream::new(7, 0, "test");
        let n = 200_000;
        let normal: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
        let mean = normal.iter().sum::<f64>() / n as f64;
        let variance = normal.iter().map(|x| x * x).sum::<f64>() / n as f64;
        // Five standard errors of each estimate.
        assert!(mean.abs() < 5.0 / (n as f64).sqrt());
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / n as f64).sqrt());
        let mean = (0..n).map(|_| stream.poisson(2.5) as f64).sum::<f64>() / n as f64;
        assert!((mean - 2.5).abs() < 5.0 * (2.5 / n as f64).sqrt());
    }
}
