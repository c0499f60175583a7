//! A tree of segments in a plan, which finds the pairs of segments near each other.
//!
//! Boxes along the axes tell long slanted segments side by side not apart. Each part of the tree therefore also has a
//! slab: the strip along its longest segment that holds all its segments.

use std::ops::Range;

const LEAF: usize = 4; // segments of a leaf, at most

type Place = [f64; 2];
pub type Segment = [Place; 2];

/// Segments whose ends are whole numbers below 2^31, ordered so that neighbours are near each other.
#[derive(Debug)]
pub struct SlabTree {
    segments: Vec<Segment>,
    /// The number of each segment before it was ordered.
    numbers: Vec<usize>,
    covers: Vec<Cover>,
}

/// The box and the slab around a part of the segments.
#[derive(Debug)]
struct Cover {
    low: Place,
    high: Place,
    /// Unit vector across the longest segment; zero if all segments are points.
    across: Place,
    /// Range of the places' products with `across`.
    slab: [f64; 2],
    /// The number of the second half's cover; the first half's follows this one. Leaves have none.
    second: usize,
}

impl SlabTree {
    pub fn new(segments: &[Segment]) -> Self {
        let mut numbers: Vec<usize> = (0..segments.len()).collect();
        let mut covers = Vec::new();
        grow(segments, &mut numbers, &mut covers);
        Self { segments: numbers.iter().map(|&k| segments[k]).collect(), numbers, covers }
    }

    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Returns whether `is_hit` holds for a pair of the segment at `rank` and one behind it in the tree's order.
    ///
    /// It is asked for all that may meet, the lower number first.
    pub fn any_pair(&self, rank: usize, mut is_hit: impl FnMut(usize, usize) -> bool) -> bool {
        let mine = self.numbers[rank];
        self.any_behind(rank, 0, 0..self.len(), &mut |other| is_hit(mine.min(other), mine.max(other)))
    }

    fn any_behind(
        &self,
        rank: usize,
        cover: usize,
        part: Range<usize>,
        is_hit: &mut impl FnMut(usize) -> bool,
    ) -> bool {
        if part.end <= rank + 1 || !self.covers[cover].meets(&self.segments[rank]) {
            return false;
        }
        if part.len() <= LEAF {
            return self.numbers[part.start.max(rank + 1)..part.end].iter().any(|&other| is_hit(other));
        }
        let middle = part.start.midpoint(part.end);
        self.any_behind(rank, cover + 1, part.start..middle, is_hit)
            || self.any_behind(rank, self.covers[cover].second, middle..part.end, is_hit)
    }
}

/// Orders segments by halves, and appends the covers of all parts.
fn grow(segments: &[Segment], numbers: &mut [usize], covers: &mut Vec<Cover>) {
    let own = covers.len();
    covers.push(Cover::new(segments, numbers));
    if numbers.len() <= LEAF {
        return;
    }
    let twice_middle = |k: usize, axis: usize| segments[k][0][axis] + segments[k][1][axis];
    let [x, y] = [0, 1].map(|axis| {
        let [low, high] = find_range(numbers.iter().map(|&k| twice_middle(k, axis)));
        high - low
    });
    let axis = usize::from(y > x);
    let half = numbers.len() / 2;
    numbers.select_nth_unstable_by(half, |&a, &b| {
        twice_middle(a, axis).total_cmp(&twice_middle(b, axis)).then(a.cmp(&b))
    });
    let (first, second) = numbers.split_at_mut(half);
    grow(segments, first, covers);
    covers[own].second = covers.len();
    grow(segments, second, covers);
}

impl Cover {
    fn new(segments: &[Segment], numbers: &[usize]) -> Self {
        let steps = numbers.iter().map(|&k| {
            let [[ax, ay], [bx, by]] = segments[k];
            let [x, y] = [bx - ax, by - ay];
            (x * x + y * y, [-y, x])
        });
        let (square, across) = steps.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        let across = if square > 0.0 { across.map(|x| x / square.sqrt()) } else { across };
        let places = || numbers.iter().flat_map(|&k| segments[k]);
        let [x, y] = [0, 1].map(|axis| find_range(places().map(|place| place[axis])));
        let [low, high] = find_range(places().map(|place| project(place, across)));
        // a step of the lattice is far more than products are rounded by
        Self { low: [x[0], y[0]], high: [x[1], y[1]], across, slab: [low - 1.0, high + 1.0], second: 0 }
    }

    fn meets(&self, [a, b]: &Segment) -> bool {
        let overlap = |a: f64, b: f64, low: f64, high: f64| a.min(b) <= high && low <= a.max(b);
        (0..2).all(|k| overlap(a[k], b[k], self.low[k], self.high[k]))
            && overlap(project(*a, self.across), project(*b, self.across), self.slab[0], self.slab[1])
    }
}

fn project(place: Place, across: Place) -> f64 {
    place[0] * across[0] + place[1] * across[1]
}

fn find_range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}
