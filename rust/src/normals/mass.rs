//! Sums over points that can be combined.

use crate::geometry::{Point, Symmetric3, advance, sub};
use crate::index::hierarchy::crowded::Sum;

/// The number of points, their mean, and the sums of products of their differences from it.
///
/// These stay accurate for points near each other and far from the origin.
#[derive(Clone, Copy)]
pub(super) struct Mass {
    count: usize,
    /// One of the points, and the mean relative to it.
    base: Point,
    mean: Point,
    spread: Symmetric3,
}

impl Mass {
    pub(super) fn of(point: Point) -> Self {
        Self { count: 1, base: point, mean: [0.0; 3], spread: [0.0; 6] }
    }

    /// Returns the covariance, or zeros if there are too few points for a plane.
    pub(super) fn covariance(&self) -> Symmetric3 {
        if self.count < 3 { [0.0; 6] } else { self.spread.map(|x| x / self.count as f64) }
    }
}

impl Sum for Mass {
    /// Combines two by the formula of Chan, Golub and LeVeque (1979).
    fn and(self, other: Self) -> Self {
        let count = self.count + other.count;
        let share = other.count as f64 / count as f64;
        let [x, y, z] = advance(sub(other.base, self.base), 1.0, sub(other.mean, self.mean));
        let weight = share * self.count as f64;
        let apart = [x * x, x * y, x * z, y * y, y * z, z * z];
        Self {
            count,
            base: self.base,
            mean: advance(self.mean, share, [x, y, z]),
            spread: std::array::from_fn(|i| self.spread[i] + other.spread[i] + weight * apart[i]),
        }
    }
}
