//! Sums over pairs, which give the pose.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::Point;
use crate::simd::{BATCH, Doubles, LANES};

/// Sums over pairs: 1, squared distance, source point, target point, and the points' outer product; points are relative
/// to an origin.
#[derive(Clone, Copy)]
pub struct Pairs {
    sums: [f64; TERMS],
    /// A place near the middle of the source points.
    pub origin: Point,
    source_points: usize,
}

pub(super) const TERMS: usize = 17; // the number of summed terms

impl Pairs {
    pub(super) fn new(sums: [f64; TERMS], origin: Point, source_points: usize) -> Self {
        Self { sums, origin, source_points }
    }

    pub fn count(&self) -> f64 {
        self.sums[0]
    }

    /// The share of source points that have a partner.
    pub fn fitness(&self) -> f64 {
        self.sums[0] / self.source_points as f64
    }

    /// The root mean square distance; 0 if there are no pairs.
    pub fn rmse(&self) -> f64 {
        if self.sums[0] > 0.0 { (self.sums[1] / self.sums[0]).sqrt() } else { 0.0 }
    }

    /// Returns the means of the paired source and target points, relative to the origin.
    pub fn means(&self) -> (Vector3<f64>, Vector3<f64>) {
        let at = |first: usize| Vector3::from_fn(|k, _| self.sums[first + k] / self.sums[0]);
        (at(2), at(5))
    }

    /// Returns Σ (target − mean) (source − mean)ᵀ.
    pub fn cross_covariance(&self) -> Matrix3<f64> {
        let (from, to) = self.means();
        Matrix3::from_fn(|i, j| self.sums[8 + 3 * i + j]) - to * from.transpose() * self.sums[0]
    }
}

/// Adds the pairs of half a batch.
#[inline(always)]
pub(super) fn add_pairs(
    sums: &mut [Doubles; TERMS],
    half: usize,
    moved: &[[f64; BATCH]; 3],
    targets: &[[f64; BATCH]; 3],
    origin: Point,
    limit: f64,
) {
    let mut terms = [[0.0; LANES]; TERMS];
    for lane in 0..LANES {
        let l = half * LANES + lane;
        let d = [targets[0][l] - moved[0][l], targets[1][l] - moved[1][l], targets[2][l] - moved[2][l]];
        let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let within = squared <= limit;
        let m = [moved[0][l] - origin[0], moved[1][l] - origin[1], moved[2][l] - origin[2]];
        let kept = |x: f64| if within { x } else { 0.0 };
        let m = [kept(m[0]), kept(m[1]), kept(m[2])];
        let t = [targets[0][l] - origin[0], targets[1][l] - origin[1], targets[2][l] - origin[2]];
        let t = [kept(t[0]), kept(t[1]), kept(t[2])];
        terms[0][lane] = if within { 1.0 } else { 0.0 };
        terms[1][lane] = if within { squared } else { 0.0 };
        for k in 0..3 {
            terms[2 + k][lane] = m[k];
            terms[5 + k][lane] = t[k];
            for j in 0..3 {
                terms[8 + 3 * k + j][lane] = t[k] * m[j];
            }
        }
    }
    for (sum, term) in sums.iter_mut().zip(&terms) {
        for lane in 0..LANES {
            sum[lane] += term[lane];
        }
    }
}
