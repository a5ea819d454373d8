//! The air on a path, in layers.

/// A layer of air that the beam crosses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Distance of its middle from the aperture \[m\].
    pub middle_m: f64,
    /// Its thickness along the path \[m\].
    pub thickness_m: f64,
    /// Mean strength of turbulence Cn² in it \[m^(-2/3)\].
    pub cn2: f64,
    /// Speed of the air across the beam (along rows, along columns), less that with which the beam itself turns over it \[m/s\].
    pub across_mps: [f64; 2],
}

impl Layer {
    /// The integral of Cn² over it \[m^(1/3)\].
    pub fn strength(&self) -> f64 {
        self.cn2 * self.thickness_m
    }
}

/// Layers of equal thickness over a path, by what is so far along it \[m\]: Cn² \[m^(-2/3)\] and the air across \[m/s\].
pub fn even_layers(length_m: f64, count: usize, of: impl Fn(f64) -> (f64, [f64; 2])) -> Vec<Layer> {
    let thickness_m = length_m / count as f64;
    let layer = |i: usize| {
        // Cn² is the mean of three places: near the ground it falls fast.
        let at = |share: f64| of((i as f64 + share) * thickness_m);
        let cn2 = (at(1.0 / 6.0).0 + at(0.5).0 + at(5.0 / 6.0).0) / 3.0;
        Layer {
            middle_m: (i as f64 + 0.5) * thickness_m,
            thickness_m,
            cn2,
            across_mps: at(0.5).1,
        }
    };
    (0..count).map(layer).collect()
}
