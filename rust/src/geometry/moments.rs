//! Means and covariances of points.

use super::eigen::Symmetric3;
use super::vector::Point;

/// Sums over points that give their mean and covariance.
///
/// Points are added relative to an origin near them, so that clouds far from the world's origin lose no precision.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    count: usize,
    first: [f64; 3],
    second: Symmetric3,
}

impl Moments {
    /// Adds a point, given relative to the common origin.
    #[inline]
    pub fn add(&mut self, d: Point) {
        self.count += 1;
        for k in 0..3 {
            self.first[k] += d[k];
        }
        self.second[0] += d[0] * d[0];
        self.second[1] += d[0] * d[1];
        self.second[2] += d[0] * d[2];
        self.second[3] += d[1] * d[1];
        self.second[4] += d[1] * d[2];
        self.second[5] += d[2] * d[2];
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns Σ (d − mean)(d − mean)ᵀ / count.
    pub fn covariance(&self) -> Symmetric3 {
        let n = self.count.max(1) as f64;
        let [x, y, z] = self.first.map(|s| s / n);
        let [xx, xy, xz, yy, yz, zz] = self.second.map(|s| s / n);
        [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z]
    }
}

#[cfg(test)]
mod tests {
    use super::super::vector::sub;
    use super::*;

    #[test]
    fn moments_far_from_the_origin_lose_nothing() {
        let origin = [1e6, -2e6, 3e6];
        let mut moments = Moments::default();
        for d in [[1e-3, 0.0, 0.0], [-1e-3, 0.0, 0.0], [0.0, 2e-3, 0.0], [0.0, -2e-3, 0.0]] {
            let p = [origin[0] + d[0], origin[1] + d[1], origin[2] + d[2]];
            moments.add(sub(p, origin));
        }
        let covariance = moments.covariance();
        assert!((covariance[0] - 0.5e-6).abs() < 1e-12 && (covariance[3] - 2e-6).abs() < 1e-12);
    }
}
