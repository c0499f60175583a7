//! How depth falls off to both sides of a rope, which tells where its middle is more exactly than a ragged mask.

const MOST_ACROSS: f64 = 0.85; // radii from the middle: farther out, depth is that of what lies behind
const LEAST_SPREAD: f64 = 0.2; // of the slopes: with less, one side alone is seen
const FAR: f64 = 0.5; // radii: ways of this size count half

/// The sums of a straight line's least squares over one sample's pixels.
///
/// On a tube of radius r whose middle is off by a, the surface at x is off in depth by a·s with the slope
/// s = −x / √(r² − x²). A common error of depth has no influence on a, nor has one that is alike on both sides.
#[derive(Clone, Copy, Default)]
pub struct Slopes {
    weight: f64,
    slope: f64,
    deep: f64,
    squared: f64,
    product: f64,
}

impl Slopes {
    /// Adds a pixel at `across` from the middle, with its difference of depth from the tube, metres.
    pub fn add(&mut self, across: f64, deep: f64, radius: f64, weight: f64) {
        if across.abs() >= MOST_ACROSS * radius {
            return;
        }
        let slope = -across / (radius * radius - across * across).sqrt();
        self.weight += weight;
        self.slope += weight * slope;
        self.deep += weight * deep;
        self.squared += weight * slope * slope;
        self.product += weight * slope * deep;
    }

    /// Returns the way across the rope to its middle, metres, and its weight, 1/m²; `noise` is that of one pixel, metres.
    pub fn solve(&self, radius: f64, noise: f64) -> (f64, f64) {
        let spread = self.squared - self.slope * self.slope / self.weight.max(f64::MIN_POSITIVE);
        if spread < LEAST_SPREAD {
            return (0.0, 0.0);
        }
        let way = (self.product - self.slope * self.deep / self.weight) / spread;
        (way, spread / (noise * noise * (1.0 + (way / (FAR * radius)).powi(2))))
    }
}
