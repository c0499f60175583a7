//! Boxes around points.

use rayon::prelude::*;

use super::limits::POINTS_PER_PART;
use crate::geometry::{Point, dot};
use crate::simd::{BATCH, LANES};

/// A box around points.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    pub low: Point,
    pub high: Point,
}

impl Bounds {
    /// The box without points.
    pub const NONE: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// The box around the points of a batch.
    #[inline(always)]
    pub fn of([x, y, z]: &[[f64; BATCH]; 3]) -> Self {
        let [x, y, z] = [find_extremes(x), find_extremes(y), find_extremes(z)];
        Self { low: [x.0, y.0, z.0], high: [x.1, y.1, z.1] }
    }

    /// Grows to hold a point.
    #[inline(always)]
    pub fn add(&mut self, p: Point) {
        self.merge(&Self { low: p, high: p });
    }

    /// Grows to hold another box.
    #[inline(always)]
    pub fn merge(&mut self, other: &Self) {
        for k in 0..3 {
            self.low[k] = if other.low[k] < self.low[k] { other.low[k] } else { self.low[k] };
            self.high[k] = if other.high[k] > self.high[k] { other.high[k] } else { self.high[k] };
        }
    }

    /// Returns the square of the least distance to a place of another box.
    ///
    /// This and [`Bounds::squared_span`] bound the computed [`squared_distance`](crate::geometry::squared_distance) of
    /// any two points of the boxes, because differences, squares and sums round monotonically.
    #[inline(always)]
    pub fn squared_gap(&self, other: &Self) -> f64 {
        let gap = |k: usize| (self.low[k] - other.high[k]).max(other.low[k] - self.high[k]).max(0.0);
        let gap = [gap(0), gap(1), gap(2)];
        dot(gap, gap)
    }

    #[inline(always)]
    /// Returns the square of the largest distance to a place of another box.
    pub fn squared_span(&self, other: &Self) -> f64 {
        let span = |k: usize| (self.high[k] - other.low[k]).max(other.high[k] - self.low[k]);
        let span = [span(0), span(1), span(2)];
        dot(span, span)
    }

    #[inline(always)]
    pub fn middle(&self) -> Point {
        std::array::from_fn(|k| 0.5 * (self.low[k] + self.high[k]))
    }

    pub fn diagonal(&self) -> f64 {
        self.sides().map(|side| side.powi(2)).iter().sum::<f64>().sqrt()
    }

    #[inline(always)]
    pub fn sides(&self) -> Point {
        std::array::from_fn(|k| self.high[k] - self.low[k])
    }

    /// The axis of its longest side, the first among equals.
    pub fn longest(&self) -> usize {
        let sides = self.sides();
        (1..3).fold(0, |longest, k| if sides[k] > sides[longest] { k } else { longest })
    }
}

/// Returns the least and the largest of some numbers.
#[inline(always)]
fn find_extremes(x: &[f64; BATCH]) -> (f64, f64) {
    let (mut low, mut high) = (*x, *x);
    for half in [8, 4, 2, 1] {
        for l in 0..half {
            low[l] = if low[l + half] < low[l] { low[l + half] } else { low[l] };
            high[l] = if high[l + half] > high[l] { high[l + half] } else { high[l] };
        }
    }
    (low[0], high[0])
}

/// Returns the box around points.
pub fn bounds(points: &[Point]) -> Bounds {
    points
        .par_chunks(POINTS_PER_PART)
        .map(|points| {
            // eight points at a time
            let mut low = [f64::INFINITY; 3 * LANES];
            let mut high = [f64::NEG_INFINITY; 3 * LANES];
            let (rows, rest) = points.as_flattened().as_chunks::<{ 3 * LANES }>();
            for row in rows {
                for l in 0..3 * LANES {
                    low[l] = if row[l] < low[l] { row[l] } else { low[l] };
                    high[l] = if row[l] > high[l] { row[l] } else { high[l] };
                }
            }
            let mut bounds = Bounds::NONE;
            for p in rest.as_chunks().0 {
                bounds.add(*p);
            }
            for (low, high) in low.as_chunks().0.iter().zip(high.as_chunks().0) {
                bounds.merge(&Bounds { low: *low, high: *high });
            }
            bounds
        })
        .reduce(
            || Bounds::NONE,
            |mut a, b| {
                a.merge(&b);
                a
            },
        )
}
