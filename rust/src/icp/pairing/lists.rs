//! Lists of near target points.

use crate::simd::{BATCH, Simd, Singles};

pub const LISTED: usize = 8; // near target points that are kept for a source point, at most
pub const NONE: u32 = u32::MAX; // stands for no target point

/// Near target points of the lanes of a batch; registers of numbers begin with lines of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct List {
    pub rows: [Row; LISTED],
}

/// A near target point of each lane.
#[derive(Clone, Copy)]
pub struct Row {
    /// Positions in the cells' order as the bits of floats; NONE if there is no point.
    pub numbers: Singles,
    /// Relative to the anchor of the lane, in cells' widths.
    pub places: [Singles; 3],
}

impl List {
    /// A list without points.
    pub const EMPTY: Self = Self {
        rows: [Row { numbers: [f32::from_bits(NONE); BATCH], places: [[f32::MAX; BATCH]; 3] }; LISTED],
    };

    /// Removes all points of some lanes.
    #[inline(always)]
    pub fn clear<S: Simd>(&mut self, simd: S, lanes: u32) {
        let lanes = simd.mask(lanes);
        for row in &mut self.rows {
            let (numbers, places) = (simd.load(&row.numbers), simd.load(&row.places[0]));
            row.numbers = simd.store(simd.select(lanes, simd.splat(f32::from_bits(NONE)), numbers));
            row.places[0] = simd.store(simd.select(lanes, simd.splat(f32::MAX), places));
        }
    }

    /// Returns the row of the point of a lane that is farthest from the anchor, and its squared distance.
    #[cold]
    pub fn farthest(&self, l: usize) -> (usize, f32) {
        let mut farthest = (0, -1.0);
        for (n, Row { places: [x, y, z], .. }) in self.rows.iter().enumerate() {
            let square = x[l] * x[l] + y[l] * y[l] + z[l] * z[l];
            if square > farthest.1 {
                farthest = (n, square);
            }
        }
        farthest
    }

    /// Positions of the points of a lane.
    #[inline(always)]
    pub fn numbers(&self, l: usize) -> [u32; LISTED] {
        std::array::from_fn(|n| self.rows[n].numbers[l].to_bits())
    }
}
