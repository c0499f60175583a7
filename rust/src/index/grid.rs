//! A uniform grid that finds the points within a radius of single points, in double precision.

use std::ops::Range;
use std::sync::OnceLock;

use rayon::prelude::*;

use super::hierarchy::Hierarchy;
use super::limits::CROWDED;
use super::sort::sort_words;
use crate::geometry::{Point, squared_distance};
use crate::simd::{LANES, kernel};

const AXIS_BITS: u32 = 21; // bits of a cell's coordinate along one axis; three coordinates make a key

const WIDE: f64 = 2.0; // wider cells would hold many points out of reach, radii
const COMPARED: usize = 64; // points that are compared with a centre at once, a bit of a word each

/// Points sorted by the cells of a uniform grid. Cells are at least one search radius wide.
///
/// Only cells with points are kept, in order of their key (x major, z minor). So three cells in a row along z are one
/// run of points, and memory does not grow with the empty space between points.
pub struct Grid {
    radius: f64,
    low: Point,
    inverse_cell: f64,
    /// Keys of the cells that hold points, ascending, and where the points of each start.
    keys: Vec<u64>,
    starts: Vec<usize>,
    /// The points' indices in the input, in order of their cells. In order of the hierarchy's boxes where cells are wide.
    order: Vec<u32>,
    /// Their coordinates along each axis, and a few numbers more, so that whole registers can be read.
    axes: [Vec<f64>; 3],
    /// Whether cells are much wider than the radius; then there are no cells, and searches use the hierarchy.
    wide: bool,
    /// The hierarchy of the points in the grid's order.
    hierarchy: OnceLock<Hierarchy>,
}

/// The points around a cell: at most nine runs of the grid's sorted points.
#[derive(Clone, Default)]
struct Runs {
    runs: [Range<usize>; 9],
}

/// The points of a grid that may lie within its radius of a centre.
struct Neighborhood<'a> {
    grid: &'a Grid,
    center: Point,
    runs: &'a [Range<usize>],
}

impl Neighborhood<'_> {
    /// Calls `visit` with each point within a reach, boundary included: its position in the grid's order, the point, and
    /// its squared distance.
    #[inline(always)]
    fn visit(&self, reach: f64, mut visit: impl FnMut(usize, Point, f64)) {
        let grid = self.grid;
        for run in self.runs {
            for start in run.clone().step_by(COMPARED) {
                let axes = [0, 1, 2].map(|k| &grid.axes[k][start..]);
                let mut near = find_near(axes, COMPARED.min(run.end - start), self.center, reach * reach);
                while near != 0 {
                    let position = start + near.trailing_zeros() as usize;
                    near &= near - 1;
                    let q = grid.point(position);
                    visit(position, q, squared_distance(q, self.center));
                }
            }
        }
    }
}

kernel! {
    /// Returns which of the first `count` points, at most 64, lie within a distance of a centre, as bits. `limit` is its
    /// square. Each axis has whole registers of numbers.
    fn find_near<S>(simd, axes: [&[f64]; 3], count: usize, center: Point, limit: f64) -> u64 {
        let [x, y, z] = axes.map(|axis| axis.as_chunks::<LANES>().0);
        let [center_x, center_y, center_z] = center;
        let (center_x, center_y) = (simd.splat_half(center_x), simd.splat_half(center_y));
        let (center_z, limit) = (simd.splat_half(center_z), simd.splat_half(limit));
        let mut far = 0;
        for (block, ((x, y), z)) in x.iter().zip(y).zip(z).take(count.div_ceil(LANES)).enumerate() {
            let x = simd.sub_half(simd.load_half(x), center_x);
            let y = simd.sub_half(simd.load_half(y), center_y);
            let z = simd.sub_half(simd.load_half(z), center_z);
            let squares = simd.add_half(simd.mul_half(x, x), simd.mul_half(y, y));
            let squares = simd.add_half(squares, simd.mul_half(z, z));
            far |= u64::from(simd.lt_half(limit, squares)) << (block * LANES);
        }
        !far & (u64::MAX >> (COMPARED - count))
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
        // a little wider than the radius, so that rounding never puts two neighbours two cells apart; and wide enough
        // that the cells of the longest axis have numbers, and that 1 / cell is finite
        let cell = (radius * (1.0 + 1e-6))
            .max(extent / f64::from(1u32 << (AXIS_BITS - 2)))
            .max(4.0 * f64::MIN_POSITIVE);
        let mut grid = Self {
            radius,
            low,
            inverse_cell: 1.0 / cell,
            keys: Vec::new(),
            starts: Vec::new(),
            order: Vec::new(),
            axes: Default::default(),
            wide: cell > WIDE * radius,
            hierarchy: OnceLock::new(),
        };
        if grid.wide {
            let mut hierarchy = Hierarchy::new(points.iter().copied());
            grid.order = hierarchy.take_order();
            grid.take(points);
            grid.hierarchy = OnceLock::from(hierarchy);
            return grid;
        }
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
        grid.take(points);
        grid
    }

    /// Takes the points' coordinates in the grid's order.
    fn take(&mut self, points: &[Point]) {
        self.axes = std::array::from_fn(|k| {
            let ordered = self.order.iter().map(|&i| points[i as usize][k]);
            ordered.chain([f64::INFINITY; LANES]).collect()
        });
    }

    /// Returns the keys of the points' cells and the points' indices, in order; `high` holds the greatest coordinates.
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
        // a key and an index in one word
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

    /// Reorders values of the points into the grid's order.
    pub fn gather<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.order.iter().map(|&i| values[i as usize]).collect()
    }

    /// Returns a hierarchy of the points, numbered by their positions in the grid's order.
    pub fn hierarchy(&self) -> &Hierarchy {
        self.hierarchy.get_or_init(|| Hierarchy::new((0..self.order.len()).map(|i| self.point(i))))
    }

    /// Whether searches may meet very many points, within the radius or beyond it.
    pub fn is_crowded(&self) -> bool {
        self.wide || self.starts.windows(2).any(|pair| pair[1] - pair[0] > CROWDED / 8)
    }

    /// Returns the index in the input of the point at a position in the grid's order.
    pub fn input_index(&self, position: usize) -> usize {
        self.order[position] as usize
    }

    /// Returns the point at a position in the grid's order.
    pub fn point(&self, position: usize) -> Point {
        [0, 1, 2].map(|k| self.axes[k][position])
    }

    /// Samples one chosen point in each voxel of side `size`: returns the positions of the first in the grid's order.
    pub fn sample(&self, size: f64, chosen: impl Fn(usize) -> bool) -> Vec<usize> {
        let voxel = |p: Point| -> [i64; 3] { std::array::from_fn(|k| ((p[k] - self.low[k]) / size) as i64) };
        let mut seen = rustc_hash::FxHashSet::default();
        let mut last = None;
        let mut is_new = |p: Point| {
            let found = voxel(p);
            // points in a row mostly share a voxel, and then need no look-up
            let is_new = last != Some(found) && seen.insert(found);
            last = Some(found);
            is_new
        };
        (0..self.order.len()).filter(|&i| chosen(i) && is_new(self.point(i))).collect()
    }

    /// Calls `visit` with each point within the radius of the grid's point at a position, boundary included: its position
    /// in the grid's order, the point, and its squared distance.
    pub fn visit_around(&self, position: usize, visit: impl FnMut(usize, Point, f64)) {
        let center = self.point(position);
        let (few, many);
        let runs = if self.wide {
            many = self.hierarchy().runs_near(center, self.radius * self.radius);
            &many[..]
        } else {
            few = Sweep::default().runs(self, key(self.cell(center)));
            &few.runs[..]
        };
        Neighborhood { grid: self, center, runs }.visit(self.radius, visit);
    }

    /// Calls `visit` with each point within a reach of any place, or the radius if that is less, as
    /// [`Grid::visit_around`] does.
    pub fn visit_near(&self, center: Point, reach: f64, visit: impl FnMut(usize, Point, f64)) {
        if center.iter().any(|x| x.is_nan()) {
            return;
        }
        let cells = |k: usize| (center[k] - self.low[k]) * self.inverse_cell;
        let (few, many);
        let runs = if self.wide {
            many = self.hierarchy().runs_near(center, self.radius * self.radius);
            &many[..]
        } else {
            // more than a cell outside the grid there are no neighbours, and the cell has no number
            if (0..3).any(|k| !(cells(k) > -1.0 && cells(k) < f64::from(1u32 << (AXIS_BITS - 1)))) {
                return;
            }
            let cell = std::array::from_fn(|k| (2.0 + cells(k).floor()) as u64);
            few = Sweep::default().runs(self, key(cell));
            &few.runs[..]
        };
        Neighborhood { grid: self, center, runs }.visit(reach.min(self.radius), visit);
    }

    /// Returns the cell of a point inside the grid's extent. Numbers start at 2, so that places one cell outside still
    /// have neighbours on all sides.
    fn cell(&self, p: Point) -> [u64; 3] {
        std::array::from_fn(|k| 2 + ((p[k] - self.low[k]) * self.inverse_cell) as u64)
    }
}

/// Returns the key of a cell: x, y and z from the highest bits down.
fn key([x, y, z]: [u64; 3]) -> u64 {
    (x << (2 * AXIS_BITS)) | (y << AXIS_BITS) | z
}

/// Nine cursors over a grid's cells, one for each column of cells around the current cell.
///
/// Callers ask for cells in ascending order, so each cursor continues from where it was.
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
                grid.visit_around(position, |other, _, _| found.push(grid.input_index(other)));
                found.sort_unstable();
                prop_assert_eq!(found, within(&points, points[grid.input_index(position)], radius));
            }
        }
    }

    proptest! {
        #[test]
        fn places_near_a_grid_meet_its_points_within_any_reach(
            points in cloud(),
            center in prop::array::uniform3(-3.0f64..3.0),
            radius in prop_oneof![Just(0.5), 0.01f64..3.0],
            share in prop_oneof![Just(0.5), 0.0f64..2.0],
        ) {
            let grid = Grid::new(&points, radius);
            let mut found = Vec::new();
            grid.visit_near(center, share * radius, |position, point, squared| {
                assert_eq!((point, squared), (grid.point(position), squared_distance(point, center)));
                found.push(grid.input_index(position));
            });
            found.sort_unstable();
            prop_assert_eq!(found, within(&points, center, share.min(1.0) * radius));
        }
    }

    #[test]
    fn many_coincident_points_are_no_trouble() {
        let points = vec![[0.25, -1.0, 3.0]; 5000];
        let mut count = 0;
        Grid::new(&points, 0.1).visit_around(17, |_, _, _| count += 1);
        assert_eq!(count, 5000);
    }
}
