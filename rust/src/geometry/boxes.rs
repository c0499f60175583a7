//! A tree of bounding boxes of ordered segments, which finds the segments near a box.

use super::vector::Point;

/// An axis-aligned box: its low and high corners.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    pub low: Point,
    pub high: Point,
}

impl Bounds {
    const EMPTY: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// Returns the smallest box around points.
    pub fn about(points: &[Point]) -> Self {
        points.iter().fold(Self::EMPTY, |all, &p| all.with(&Self { low: p, high: p }))
    }

    /// The longest edge; 0 without points.
    pub fn extent(&self) -> f64 {
        (0..3).map(|k| self.high[k] - self.low[k]).fold(0.0, f64::max)
    }

    fn with(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    /// Returns whether both boxes have a common place.
    pub fn meets(&self, other: &Self) -> bool {
        // no branches: three comparisons cost less than one mispredicted branch
        (0..3).fold(true, |meets, k| meets & (self.low[k] <= other.high[k]) & (other.low[k] <= self.high[k]))
    }
}

/// Boxes of the segments as leaves; each node above bounds its two children.
pub struct BoxTree {
    leaves: usize,
    boxes: Vec<Bounds>,
}

impl BoxTree {
    pub fn new(segments: impl ExactSizeIterator<Item = [Point; 2]>) -> Self {
        let leaves = segments.len().next_power_of_two();
        let mut boxes = vec![Bounds::EMPTY; 2 * leaves];
        for (k, segment) in segments.enumerate() {
            boxes[leaves + k] = Bounds::about(&segment);
        }
        for k in (1..leaves).rev() {
            boxes[k] = boxes[2 * k].with(&boxes[2 * k + 1]);
        }
        Self { leaves, boxes }
    }

    /// Extends the box of a segment to a point.
    pub fn stretch(&mut self, segment: usize, to: Point) {
        let mut k = self.leaves + segment;
        while k > 0 {
            self.boxes[k] = self.boxes[k].with(&Bounds { low: to, high: to });
            k /= 2;
        }
    }

    /// Returns whether `is_hit` holds for a segment, numbered `first` or higher, whose box meets `bounds`.
    pub fn any(&self, bounds: &Bounds, first: usize, mut is_hit: impl FnMut(usize) -> bool) -> bool {
        let mut k: usize = 1;
        loop {
            // whether the node's last leaf comes before `first`
            let is_before =
                first > 0 && ((k + 1) << (self.leaves.ilog2() - k.ilog2())) - self.leaves <= first;
            if !is_before && self.boxes[k].meets(bounds) {
                if k < self.leaves {
                    k *= 2;
                    continue;
                }
                if is_hit(k - self.leaves) {
                    return true;
                }
            }
            // climb from right children, then go to the right sibling
            k >>= k.trailing_ones();
            if k == 0 {
                return false;
            }
            k += 1;
        }
    }
}
