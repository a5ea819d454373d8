//! stub until the estimator's author delivers
/// Range.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranging {
    span_m: f64,
    rel: f64,
    r: f64,
    s: f64,
}
impl Ranging {
    /// New.
    pub fn new(span_m: f64, sigma_rel: f64) -> Self {
        Self {
            span_m,
            rel: sigma_rel,
            r: 1000.0,
            s: 1000.0,
        }
    }
    /// Size.
    pub fn on_size(&mut self, size_rad: f64, _sigma_rel: f64, _t_s: f64) {
        if self.s > 50.0 {
            self.r = self.span_m / size_rad;
            self.s = self.rel * self.r;
        }
    }
    /// Laser.
    pub fn on_laser(&mut self, range_m: f64, sigma_m: f64, _t_s: f64) {
        self.r = range_m;
        self.s = sigma_m;
    }
    /// Range and sigma.
    pub fn range_m(&self, _t_s: f64) -> (f64, f64) {
        (self.r, self.s)
    }
    /// Closing.
    pub fn closing_mps(&self, _t_s: f64) -> f64 {
        0.0
    }
}
