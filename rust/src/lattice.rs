//! Places as whole numbers, so that their sums are exact and do not depend on the order.
//!
//! Numbers are kept modulo 2³²: differences of places that are near each other are right wherever they are. Sums need
//! half the registers of double precision.

use crate::Point;
use crate::wide::{BATCH, Simd};

/// Numbers that are added modulo 2³² before the sum is put aside.
pub const TERMS: usize = 64;

/// A cubic lattice, to whose places others are rounded.
#[derive(Debug, Clone, Copy)]
pub struct Lattice {
    origin: Point,
    /// Between neighbours, a power of two.
    step: f64,
    inverse: f64,
}

impl Lattice {
    /// The finest about an origin with room for sums of differences up to `reach`.
    pub fn new(origin: Point, reach: f64) -> Self {
        let least = reach * (TERMS as f64 / f64::from(1u32 << 31));
        // the next power of two: products with it are exact
        let step = f64::from_bits(((least.max(f64::MIN_POSITIVE).to_bits() >> 52) + 1) << 52);
        Self { origin, step, inverse: 1.0 / step }
    }

    /// The numbers of the nearest place along each axis.
    #[inline(always)]
    fn steps(&self, place: Point) -> [i64; 3] {
        std::array::from_fn(|k| {
            let steps = (place[k] - self.origin[k]) * self.inverse;
            (steps + 0.5f64.copysign(steps)) as i64
        })
    }

    /// The same modulo 2³².
    #[inline(always)]
    pub fn number(&self, place: Point) -> [i32; 3] {
        self.steps(place).map(|steps| steps as i32)
    }

    /// The nearest place, moved by a mean of numbers.
    #[inline(always)]
    pub fn moved(&self, place: Point, sums: [i64; 3], count: usize) -> Point {
        let steps = self.steps(place);
        std::array::from_fn(|k| {
            self.origin[k] + self.step * (steps[k] as f64 + sums[k] as f64 / count as f64)
        })
    }
}

/// Sums in each lane.
pub struct Sums<S: Simd> {
    now: [S::I; 3],
    terms: usize,
    aside: [[i64; BATCH]; 3],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        Self { now: [simd.splat_whole(0); 3], terms: 0, aside: [[0; BATCH]; 3] }
    }

    /// Adds numbers in the lanes of a mask.
    #[inline(always)]
    pub fn add(&mut self, simd: S, mask: S::M, numbers: [S::I; 3]) {
        for k in 0..3 {
            self.now[k] = simd.add_whole_if(mask, self.now[k], numbers[k]);
        }
        self.terms += 1;
        if self.terms == TERMS {
            self.put_aside(simd);
        }
    }

    #[inline(always)]
    fn put_aside(&mut self, simd: S) {
        for k in 0..3 {
            for (sum, now) in self.aside[k].iter_mut().zip(simd.store_whole(self.now[k])) {
                *sum += i64::from(now);
            }
            self.now[k] = simd.splat_whole(0);
        }
        self.terms = 0;
    }

    /// The sums.
    #[inline(always)]
    pub fn finish(mut self, simd: S) -> [[i64; BATCH]; 3] {
        self.put_aside(simd);
        self.aside
    }
}
