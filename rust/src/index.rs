//! Neighbour search: the only place that knows a grid or a tree.
//!
//! Three structures. What lies around every point of a cloud is asked of batches of points at once:
//! [`cells::Cells`] sorts the points by cell, and [`around::Around`] gathers what a batch needs in single precision.
//! What lies within a radius of single points, [`Grid`] tells in double precision. Where neighbours have no known
//! scale, [`Tree`], a k-d tree, finds the nearest.

pub mod around;
pub mod cells;

use std::num::NonZeroUsize;
use std::ops::Range;

use rayon::prelude::*;

use crate::checks::check_finite;
use crate::error::Result;
use crate::geometry::{dot, squared_distance, sub};
use crate::index::cells::sort_words;
use crate::{Point, parallel};

/// Bits of a cell's coordinate along one axis; three of them make a key.
const AXIS_BITS: u32 = 21;
/// Most points in a leaf of a tree.
const LEAF: usize = 16;
/// Points of a subtree that one task builds.
const POINTS_PER_TASK: usize = 4096;

/// Points sorted by the cells of a uniform grid, whose cells are at least one search radius wide.
///
/// Cells are kept sparse and in order of their key (x major, z minor), so three cells in a row along z are
/// one run of points, and memory does not grow with the empty space between points.
pub struct Grid {
    radius: f64,
    low: Point,
    inverse_cell: f64,
    /// Keys of the cells that hold points, ascending, and where each one's points start.
    keys: Vec<u64>,
    starts: Vec<usize>,
    /// The points in order of their cells, and each one's index in the input.
    points: Vec<Point>,
    order: Vec<u32>,
}

/// Where the points around a cell are: at most nine runs of the grid's sorted points.
#[derive(Clone, Default)]
struct Runs {
    runs: [Range<usize>; 9],
}

/// The points of a grid that may lie within its radius of a centre.
pub struct Neighborhood<'a> {
    grid: &'a Grid,
    center: Point,
    runs: &'a Runs,
}

impl Neighborhood<'_> {
    /// Calls `visit` with each point within the grid's radius (boundary included): its position in the
    /// grid's order, itself and its squared distance. Stops when `visit` returns false.
    #[inline]
    pub fn visit(&self, mut visit: impl FnMut(usize, Point, f64) -> bool) {
        let limit = self.grid.radius * self.grid.radius;
        for run in &self.runs.runs {
            for (position, &q) in run.clone().zip(&self.grid.points[run.clone()]) {
                let squared = squared_distance(q, self.center);
                if squared <= limit && !visit(position, q, squared) {
                    return;
                }
            }
        }
    }
}

impl Grid {
    /// Sorts finite points for searches within `radius` > 0.
    pub fn new(points: &[Point], radius: f64) -> Self {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for p in points {
            for k in 0..3 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        let extent = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        // a little wider than the radius, so that rounding never puts two neighbours two cells apart; and
        // wide enough that the cells of the longest axis can be numbered, and that 1 / cell is finite
        let cell = (radius * (1.0 + 1e-6))
            .max(extent / f64::from(1u32 << (AXIS_BITS - 2)))
            .max(4.0 * f64::MIN_POSITIVE);
        let mut grid = Self {
            radius,
            low,
            inverse_cell: 1.0 / cell,
            keys: Vec::new(),
            starts: Vec::new(),
            points: Vec::new(),
            order: Vec::new(),
        };
        let mut last = None;
        for (position, (key, i)) in grid.sorted(points, high).into_iter().enumerate() {
            if last != Some(key) {
                last = Some(key);
                grid.keys.push(key);
                grid.starts.push(position);
            }
            grid.order.push(i);
        }
        grid.starts.push(points.len());
        grid.points = grid.gather(points);
        grid
    }

    /// The keys of the points' cells and their indices, in order; `high` are the greatest coordinates.
    fn sorted(&self, points: &[Point], high: Point) -> Vec<(u64, u32)> {
        let keyed = || points.iter().zip(0u32..).map(|(&p, i)| (self.cell(p), i));
        let bits = |number: u64| u64::BITS - number.leading_zeros();
        let index_bits = bits(points.len() as u64);
        let [x_bits, y_bits, z_bits] = if points.is_empty() { [0; 3] } else { self.cell(high).map(bits) };
        let key_bits = x_bits + y_bits + z_bits;
        if key_bits + index_bits > u64::BITS {
            let mut sorted: Vec<(u64, u32)> = keyed().map(|(cell, i)| (key(cell), i)).collect();
            sorted.par_sort_unstable();
            return sorted;
        }
        // a cell and an index in one word
        let words = keyed()
            .map(|([x, y, z], i)| (((((x << y_bits) | y) << z_bits) | z) << index_bits) | u64::from(i));
        let part = |word: u64, shift: u32, bits: u32| (word >> shift) & ((1 << bits) - 1);
        let split = |word: u64| {
            let z = part(word, index_bits, z_bits);
            let y = part(word, index_bits + z_bits, y_bits);
            let x = part(word, index_bits + z_bits + y_bits, x_bits);
            (key([x, y, z]), part(word, 0, index_bits) as u32)
        };
        sort_words(words.collect(), index_bits, key_bits).into_iter().map(split).collect()
    }

    /// Values of the points, put in the grid's order.
    pub fn gather<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.order.iter().map(|&i| values[i as usize]).collect()
    }

    /// The index in the input of the point at a position of the grid's order.
    pub fn input_index(&self, position: usize) -> usize {
        self.order[position] as usize
    }

    /// The point at a position of the grid's order.
    pub fn point(&self, position: usize) -> Point {
        self.points[position]
    }

    /// Positions of one point in each cube of side `size` that holds points of a choice: the first in the grid's
    /// order.
    pub fn sample(&self, size: f64, chosen: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut seen = std::collections::HashSet::new();
        let cube = |p: Point| -> [i64; 3] { std::array::from_fn(|k| ((p[k] - self.low[k]) / size) as i64) };
        (0..self.points.len()).filter(|&i| chosen(i) && seen.insert(cube(self.points[i]))).collect()
    }

    /// Calls `visit` with each point within the radius of one of the grid's points, given by its position,
    /// as [`Neighborhood::visit`] does.
    pub fn visit_around(&self, position: usize, visit: impl FnMut(usize, Point, f64) -> bool) {
        let center = self.points[position];
        let runs = Sweep::default().runs(self, key(self.cell(center)));
        Neighborhood { grid: self, center, runs: &runs }.visit(visit);
    }

    /// Calls `visit` with each point within the radius of a place anywhere, as [`Neighborhood::visit`] does.
    pub fn visit_near(&self, center: Point, visit: impl FnMut(usize, Point, f64) -> bool) {
        // farther outside than a cell there are no neighbours, nor a number for the cell
        let inside = (0..3).all(|k| {
            let cells = (center[k] - self.low[k]) * self.inverse_cell;
            cells > -1.0 && cells < f64::from(1u32 << (AXIS_BITS - 1))
        });
        if inside {
            let cell = std::array::from_fn(|k| {
                (2.0 + ((center[k] - self.low[k]) * self.inverse_cell).floor()) as u64
            });
            let runs = Sweep::default().runs(self, key(cell));
            Neighborhood { grid: self, center, runs: &runs }.visit(visit);
        }
    }

    /// The cell of a point inside the grid's extent; numbered from 2, so that places one cell outside have
    /// neighbours on all sides.
    fn cell(&self, p: Point) -> [u64; 3] {
        std::array::from_fn(|k| 2 + ((p[k] - self.low[k]) * self.inverse_cell) as u64)
    }
}

/// Key of a cell: x, y and z in order of weight.
fn key([x, y, z]: [u64; 3]) -> u64 {
    (x << (2 * AXIS_BITS)) | (y << AXIS_BITS) | z
}

/// Nine cursors over a grid's cells, one for each column of cells around the current one.
///
/// Cells are asked for in ascending order, so each cursor moves on from where it was.
#[derive(Default)]
struct Sweep {
    cursors: Option<[usize; 9]>,
}

impl Sweep {
    fn runs(&mut self, grid: &Grid, key: u64) -> Runs {
        let mut runs = Runs::default();
        let column = |c: usize| {
            let (dx, dy) = (c as u64 / 3, c as u64 % 3);
            key + (dx << (2 * AXIS_BITS)) + (dy << AXIS_BITS) - (1 << (2 * AXIS_BITS)) - (1 << AXIS_BITS)
        };
        let cursors = self.cursors.get_or_insert_with(|| {
            std::array::from_fn(|c| grid.keys.partition_point(|&other| other < column(c) - 1))
        });
        for (c, cursor) in cursors.iter_mut().enumerate() {
            let middle = column(c);
            while *cursor < grid.keys.len() && grid.keys[*cursor] < middle - 1 {
                *cursor += 1;
            }
            let mut end = *cursor;
            while end < grid.keys.len() && grid.keys[end] <= middle + 1 {
                end += 1;
            }
            runs.runs[c] = grid.starts[*cursor]..grid.starts[end];
        }
        runs
    }
}

/// A k-d tree over points: their nearest to places anywhere.
///
/// Points are halved across the longest side of their box down to small leaves, which suits long thin clouds. They are
/// kept in the leaves' order, and a subtree is a run of them.
///
/// ```
/// let tree = strand::Tree::new(&[[0.0; 3], [1.0, 0.0, 0.0]])?;
/// assert_eq!(tree.nearest_within([0.9, 0.0, 0.0], 1.0).map(|(index, _)| index), Some(1));
/// # Ok::<(), strand::Error>(())
/// ```
pub struct Tree {
    /// Cuts, each before those of its lower and then of its upper half.
    cuts: Vec<Cut>,
    points: Vec<Point>,
    order: Vec<u32>,
    low: Point,
    high: Point,
}

/// Where a run of points is halved.
struct Cut {
    axis: usize,
    /// The upper end of the lower half along the axis, and the lower end of the upper half.
    ends: [f64; 2],
    /// Where the upper half's cuts are, counted from this one.
    upper: usize,
}

/// What a search has found so far.
trait Found {
    /// Points at this squared distance or farther are of no interest.
    fn bound(&self) -> f64;
    /// Takes a point that is nearer than the bound.
    fn add(&mut self, squared: f64, position: usize);
}

/// The nearest point: its squared distance (the bound, until there is one) and its position.
struct Nearest(f64, Option<usize>);

impl Found for Nearest {
    #[inline]
    fn bound(&self) -> f64 {
        self.0
    }

    #[inline]
    fn add(&mut self, squared: f64, position: usize) {
        *self = Self(squared, Some(position));
    }
}

/// The nearest points, nearest first.
struct SeveralNearest {
    found: Vec<(f64, u32)>,
    count: usize,
}

impl Found for SeveralNearest {
    #[inline]
    fn bound(&self) -> f64 {
        if self.found.len() < self.count { f64::INFINITY } else { self.found[self.count - 1].0 }
    }

    #[inline]
    fn add(&mut self, squared: f64, position: usize) {
        self.found.truncate(self.count - 1);
        let mut place = self.found.len();
        self.found.push((squared, position as u32));
        while place > 0 && self.found[place - 1].0 > squared {
            self.found[place] = self.found[place - 1];
            place -= 1;
        }
        self.found[place] = (squared, position as u32);
    }
}

impl Tree {
    /// Builds the tree.
    ///
    /// # Errors
    /// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite.
    pub fn new(points: &[Point]) -> Result<Self> {
        check_finite("points", points)?;
        Ok(parallel::run(|| Self::of_finite(points)))
    }

    /// Builds the tree of points that are known to be finite.
    pub(crate) fn of_finite(points: &[Point]) -> Self {
        let mut keyed: Vec<(Point, u32)> = points.iter().zip(0..).map(|(&p, i)| (p, i)).collect();
        let cuts = halve(&mut keyed);
        let (points, order): (Vec<Point>, Vec<u32>) = keyed.into_iter().unzip();
        let (low, high) = bounds(points.iter());
        Self { cuts, points, order, low, high }
    }

    /// The nearest point to a place whose squared distance from it is not above `limit`: its index and that distance.
    #[inline]
    pub fn nearest_within(&self, center: Point, limit: f64) -> Option<(usize, f64)> {
        let mut found = Nearest(limit.next_up(), None);
        self.search(center, &mut found);
        found.1.map(|position| (self.order[position] as usize, found.0))
    }

    /// The `count` nearest points to a place, nearest first: their indices.
    pub fn nearest(&self, center: Point, count: NonZeroUsize) -> impl Iterator<Item = usize> {
        let count = count.get().min(self.points.len());
        let mut several = SeveralNearest { found: Vec::with_capacity(count), count };
        if count > 0 {
            self.search(center, &mut several);
        }
        several.found.into_iter().map(|(_, position)| self.order[position as usize] as usize)
    }

    #[inline]
    fn search(&self, center: Point, found: &mut impl Found) {
        let gaps = std::array::from_fn(|k| (self.low[k] - center[k]).max(center[k] - self.high[k]).max(0.0));
        self.descend(center, found, 0, 0, self.points.len(), gaps);
    }

    /// Searches a run of points whose box is `gaps` away from the centre along the axes.
    fn descend(
        &self,
        center: Point,
        found: &mut impl Found,
        cut: usize,
        start: usize,
        end: usize,
        gaps: Point,
    ) {
        if end - start <= LEAF {
            for (position, &q) in (start..end).zip(&self.points[start..end]) {
                let squared = squared_distance(q, center);
                if squared < found.bound() {
                    found.add(squared, position);
                }
            }
            return;
        }
        let Cut { axis, ends, upper } = self.cuts[cut];
        let middle = start + (end - start) / 2;
        let (above, below) = (center[axis] - ends[0], ends[1] - center[axis]);
        let mut far = gaps;
        // gaps are summed as distances are, so that rounding cannot put a box beyond one of its points;
        // two branches, not a choice of values: the processor then reads on before it knows the outcome
        if above < below {
            self.descend(center, found, cut + 1, start, middle, gaps);
            far[axis] = below.max(gaps[axis]);
            if dot(far, far) < found.bound() {
                self.descend(center, found, cut + upper, middle, end, far);
            }
        } else {
            self.descend(center, found, cut + upper, middle, end, gaps);
            far[axis] = above.max(gaps[axis]);
            if dot(far, far) < found.bound() {
                self.descend(center, found, cut + 1, start, middle, far);
            }
        }
    }
}

/// Sorts points into the leaves of a tree and gives its cuts.
fn halve(points: &mut [(Point, u32)]) -> Vec<Cut> {
    if points.len() <= LEAF {
        return Vec::new();
    }
    let (low, high) = bounds(points.iter().map(|(p, _)| p));
    let sides = sub(high, low);
    let axis = (0..3).fold(0, |longest, k| if sides[k] > sides[longest] { k } else { longest });
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |(p, i), (q, j)| p[axis].total_cmp(&q[axis]).then(i.cmp(j)));
    let upper_end = points[middle].0[axis];
    let (lower, upper) = points.split_at_mut(middle);
    let lower_end = lower.iter().fold(f64::NEG_INFINITY, |end, (p, _)| end.max(p[axis]));
    let (lower, upper) = if middle > POINTS_PER_TASK {
        rayon::join(|| halve(lower), || halve(upper))
    } else {
        (halve(lower), halve(upper))
    };
    let mut cuts = vec![Cut { axis, ends: [lower_end, upper_end], upper: 1 + lower.len() }];
    cuts.extend(lower);
    cuts.extend(upper);
    cuts
}

/// The box around points.
fn bounds<'a>(points: impl Iterator<Item = &'a Point>) -> (Point, Point) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), p| {
        (std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Clouds as depth cameras make them: lattices, planes, lines, duplicates, and a far outlier.
    fn cloud() -> impl Strategy<Value = Vec<Point>> {
        let lattice = prop::array::uniform3(-4i32..4).prop_map(|p| p.map(|x| f64::from(x) * 0.5));
        let free = prop::array::uniform3(-2.0f64..2.0);
        let plane = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| [p[0], p[1], 0.5]);
        let far = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| [p[0] * 1e7, p[1], p[2]]);
        prop::collection::vec(prop_oneof![8 => lattice, 4 => free, 4 => plane, 1 => far], 1..200)
    }

    fn within(points: &[Point], center: Point, radius: f64) -> Vec<usize> {
        (0..points.len()).filter(|&j| squared_distance(points[j], center) <= radius * radius).collect()
    }

    proptest! {
        #[test]
        fn a_grid_finds_what_brute_force_finds(points in cloud(), radius in prop_oneof![Just(0.5), Just(1.0), 0.01f64..3.0]) {
            let grid = Grid::new(&points, radius);
            for position in 0..points.len() {
                let mut found = Vec::new();
                grid.visit_around(position, |other, _, _| { found.push(grid.input_index(other)); true });
                found.sort_unstable();
                prop_assert_eq!(found, within(&points, points[grid.input_index(position)], radius));
            }
        }

        #[test]
        fn a_tree_finds_what_brute_force_finds(points in cloud(), center in prop::array::uniform3(-3.0f64..3.0), count in 1usize..40) {
            let tree = Tree::of_finite(&points);
            let mut expected: Vec<f64> = points.iter().map(|&p| squared_distance(p, center)).collect();
            expected.sort_by(f64::total_cmp);
            let found: Vec<f64> = tree
                .nearest(center, NonZeroUsize::new(count).unwrap())
                .map(|i| squared_distance(points[i], center))
                .collect();
            prop_assert_eq!(&found[..], &expected[..count.min(points.len())]);
            let nearest = expected[0];
            prop_assert_eq!(tree.nearest_within(center, nearest).map(|(_, squared)| squared), Some(nearest));
            prop_assert!(nearest == 0.0 || tree.nearest_within(center, nearest.next_down()).is_none());
        }
    }

    #[test]
    fn many_coincident_points_are_no_trouble() {
        let points = vec![[0.25, -1.0, 3.0]; 5000];
        assert_eq!(Tree::of_finite(&points).nearest([0.0; 3], NonZeroUsize::new(7).unwrap()).count(), 7);
        let mut count = 0;
        Grid::new(&points, 0.1).visit_around(17, |_, _, _| {
            count += 1;
            true
        });
        assert_eq!(count, 5000);
    }
}
