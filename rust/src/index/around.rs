//! A batch of points, one in each lane, and all points around it.
//!
//! Distances are in single precision, relative to the batch and in units of the width of a cell. The possible rounding
//! error is known, so callers see which answers are certain. Each lane meets the points in the order of the cells, so
//! sums are equal bit for bit for any instruction width.

use super::bounds::Bounds;
use super::cells::Cells;
use super::cells::sweep::Sweep;
use super::limits::CROWDED;
use crate::geometry::Point;
use crate::simd::{BATCH, Simd, Singles};

/// The points around a batch, and buffers that a task reuses from batch to batch.
#[derive(Default)]
pub struct Around {
    sweep: Sweep,
    near: [Vec<f32>; 3],
    /// Their positions, as the bits of floats.
    positions: Vec<f32>,
    count: usize,
    /// Their values, if they carry any.
    values: Vec<Point>,
    inside: Inside,
}

/// The frame of a batch's single-precision coordinates.
#[derive(Clone, Copy)]
pub struct Frame {
    pub origin: Point,
    /// Its units in a metre.
    pub unit: f64,
    /// Largest rounding error of a squared distance up to the reach.
    pub rounding: f32,
    /// Largest distance between points.
    pub extent: f64,
}

const LANE_NUMBERS: [u32; BATCH] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]; // the numbers of the lanes

/// The points that are certainly within reach of a whole box: their number, and the sums of the values that they carry.
#[derive(Default, Clone, Copy)]
pub struct Inside {
    pub count: usize,
    pub sums: Point,
}

/// Values that the points of a cloud carry, axis by axis in the cells' order, each list padded by one row of lanes.
pub type Carried = [Vec<f64>; 3];

impl Around {
    /// Finds all points within `reach` of a box, and perhaps a few farther ones; returns None where the cells are
    /// crowded or too wide.
    #[inline(always)]
    pub fn find<S: Simd>(&mut self, simd: S, cells: &Cells, bounds: &Bounds, reach: f64) -> Option<Frame> {
        self.find_few(simd, cells, bounds, reach, CROWDED)
    }

    /// As [`Around::find`], but returns None if the cells hold more than `most` points.
    #[inline(always)]
    pub fn find_few<S: Simd>(
        &mut self,
        simd: S,
        cells: &Cells,
        bounds: &Bounds,
        reach: f64,
        most: usize,
    ) -> Option<Frame> {
        if !self.sweep.find(cells, bounds, reach, most) {
            return None;
        }
        let frame = Frame::new(cells, bounds, reach);
        self.gather::<S, false>(simd, cells, bounds, reach, &frame, [&[]; 3]);
        Some(frame)
    }

    /// As [`Around::find`], with the values that points carry, relative to the frame. Points that are certainly within
    /// reach of the whole box are only counted and summed.
    #[inline(always)]
    pub fn find_carried<S: Simd>(
        &mut self,
        simd: S,
        cells: &Cells,
        bounds: &Bounds,
        reach: f64,
        carried: &Carried,
    ) -> Option<Frame> {
        if !self.sweep.find(cells, bounds, reach, CROWDED) {
            return None;
        }
        let frame = Frame::new(cells, bounds, reach);
        self.gather::<S, true>(simd, cells, bounds, reach, &frame, carried.each_ref().map(Vec::as_slice));
        Some(frame)
    }

    #[inline(always)]
    fn gather<S: Simd, const CARRY: bool>(
        &mut self,
        simd: S,
        cells: &Cells,
        bounds: &Bounds,
        reach: f64,
        frame: &Frame,
        carried: [&[f64]; 3],
    ) {
        let &Frame { origin, unit, .. } = frame;
        let (nearest, farthest) = frame.limits(reach);
        let (nearest, farthest) = (simd.splat(nearest), simd.splat(farthest));
        // far from the world's origin, rounding may move the middle of a box
        let side = |k: usize| ((bounds.high[k] - origin[k]).max(origin[k] - bounds.low[k]) * unit) as f32;
        let half = [simd.splat(side(0)), simd.splat(side(1)), simd.splat(side(2))];
        let most = self.sweep.runs.iter().map(|run| run.len() + BATCH).sum::<usize>();
        for values in self.near.iter_mut().chain([&mut self.positions]) {
            if values.len() < most {
                values.resize(2 * most, 0.0);
            }
        }
        let [to_x, to_y, to_z] = self.near.each_mut().map(|values| &mut values[..most]);
        let to_positions = &mut self.positions[..most];
        let [from_x, from_y, from_z] = cells.coordinates.each_ref().map(|values| values.as_slice());
        let mut count = 0;
        let mut inside = [[simd.splat_half(0.0); 2]; 3];
        let mut inside_count = 0;
        for run in &self.sweep.runs {
            // whole rows: the lists are padded by one
            let rows = run.start..run.start + run.len().next_multiple_of(BATCH);
            let [x, y, z] = [&from_x[rows.clone()], &from_y[rows.clone()], &from_z[rows.clone()]];
            let [x, y, z] = [x.as_chunks().0, y.as_chunks().0, z.as_chunks().0];
            for (((x, y), z), first) in x.iter().zip(y).zip(z).zip(rows.step_by(BATCH)) {
                let x = simd.narrow(x, origin[0], unit);
                let y = simd.narrow(y, origin[1], unit);
                let z = simd.narrow(z, origin[2], unit);
                let [gap_x, gap_y, gap_z] =
                    [gap(simd, x, half[0]), gap(simd, y, half[1]), gap(simd, z, half[2])];
                let gaps = simd.add(simd.add(gap_x, gap_y), gap_z);
                let in_run = (1u32 << (run.end - first).min(BATCH)) - 1;
                let mut bits = simd.bits(simd.le(gaps, farthest)) & in_run;
                if CARRY {
                    let [far_x, far_y, far_z] =
                        [far(simd, x, half[0]), far(simd, y, half[1]), far(simd, z, half[2])];
                    let fars = simd.add(simd.add(far_x, far_y), far_z);
                    let within = simd.bits(simd.le(fars, nearest)) & bits;
                    bits &= !within;
                    inside_count += within.count_ones();
                    if within != 0 {
                        add_row(
                            simd,
                            &mut inside,
                            simd.mask(within),
                            carried.map(|list| &list[first..]),
                            origin,
                        );
                    }
                }
                let numbers = LANE_NUMBERS.map(|l| f32::from_bits(first as u32 + l));
                simd.compress(bits, x, &mut to_x[count..]);
                simd.compress(bits, y, &mut to_y[count..]);
                simd.compress(bits, z, &mut to_z[count..]);
                simd.compress(bits, simd.load(&numbers), &mut to_positions[count..]);
                count += bits.count_ones() as usize;
            }
        }
        if CARRY {
            if self.values.len() < count {
                self.values.resize(2 * count, [0.0; 3]);
            }
            for (value, number) in self.values.iter_mut().zip(&self.positions[..count]) {
                let i = number.to_bits() as usize;
                *value = std::array::from_fn(|k| carried[k][i] - origin[k]);
            }
        }
        self.count = count;
        let mut sums = [0.0; 3];
        for k in 0..3 {
            for half in inside[k] {
                for x in simd.store_half(half) {
                    sums[k] += x;
                }
            }
        }
        self.inside = Inside { count: inside_count as usize, sums };
    }

    /// Points that are certainly within reach of the whole box, if points carry values.
    #[inline(always)]
    pub fn inside(&self) -> Inside {
        self.inside
    }

    /// The values that the points carry, relative to the frame.
    #[inline(always)]
    pub fn values(&self) -> &[Point] {
        &self.values[..self.count]
    }

    #[inline(always)]
    pub fn count(&self) -> usize {
        self.count
    }

    /// The positions of the points.
    #[inline(always)]
    pub fn positions(&self) -> impl ExactSizeIterator<Item = usize> {
        self.positions[..self.count].iter().map(|number| number.to_bits() as usize)
    }

    /// Returns the position of a point, as the bits of a float, and its coordinates; `number` is its number among the
    /// points around.
    #[inline(always)]
    pub fn at(&self, number: usize) -> Option<(f32, [f32; 3])> {
        if number >= self.count {
            return None;
        }
        Some((self.positions[number], [self.near[0][number], self.near[1][number], self.near[2][number]]))
    }

    /// The points' coordinates along each axis.
    #[inline(always)]
    pub fn axes(&self) -> [&[f32]; 3] {
        self.near.each_ref().map(|values| &values[..self.count])
    }
}

/// Adds the values of a row of lanes, relative to an origin.
#[inline(always)]
fn add_row<S: Simd>(simd: S, sums: &mut [[S::D; 2]; 3], mask: S::M, places: [&[f64]; 3], origin: Point) {
    for k in 0..3 {
        let ([low, high, ..], _) = places[k].as_chunks() else { unreachable!("lists are padded by a row") };
        let origin = simd.splat_half(origin[k]);
        let (low, high) = (simd.load_half(low), simd.load_half(high));
        let [first, second] = &mut sums[k];
        *first = simd.add_half_if(simd.half::<false>(mask), *first, simd.sub_half(low, origin));
        *second = simd.add_half_if(simd.half::<true>(mask), *second, simd.sub_half(high, origin));
    }
}

/// Returns the squared distance along an axis from a box around the origin.
#[inline(always)]
fn gap<S: Simd>(simd: S, x: S::F, half: S::F) -> S::F {
    let zero = simd.splat(0.0);
    let gap = simd.max(simd.sub(simd.max(x, simd.sub(zero, x)), half), zero);
    simd.mul(gap, gap)
}

/// Returns the squared distance along an axis to the far side of a box around the origin.
#[inline(always)]
fn far<S: Simd>(simd: S, x: S::F, half: S::F) -> S::F {
    let far = simd.add(simd.max(x, simd.sub(simd.splat(0.0), x)), half);
    simd.mul(far, far)
}

/// Returns the squared distances from a point to the points of a batch.
#[inline(always)]
pub fn squared_distances<S: Simd>(simd: S, x: f32, y: f32, z: f32, batch: [S::F; 3]) -> S::F {
    let [x, y, z] = [simd.splat(x), simd.splat(y), simd.splat(z)];
    let [x, y, z] = [simd.sub(x, batch[0]), simd.sub(y, batch[1]), simd.sub(z, batch[2])];
    simd.add(simd.add(simd.mul(x, x), simd.mul(y, y)), simd.mul(z, z))
}

impl Frame {
    /// Makes the frame of a box.
    #[inline(always)]
    fn new(cells: &Cells, bounds: &Bounds, reach: f64) -> Self {
        let unit = 1.0 / cells.size();
        let origin: Point = std::array::from_fn(|k| 0.5 * (bounds.low[k] + bounds.high[k]));
        let extent = reach + bounds.diagonal();
        // rounding of coordinates up to the extent affects distances up to the reach; the floor is for tiny reaches
        let (reach_units, extent_units) = (reach * unit, extent * unit);
        let rounding = (1e-6 * reach_units * extent_units).max(1e-13 * extent_units * extent_units) as f32;
        Self { origin, unit, rounding, extent }
    }

    /// Converts the points of a batch.
    #[inline(always)]
    pub fn narrow<S: Simd>(&self, simd: S, [x, y, z]: &[[f64; BATCH]; 3]) -> [Singles; 3] {
        let [a, b, c] = self.origin;
        [
            simd.store(simd.narrow(x, a, self.unit)),
            simd.store(simd.narrow(y, b, self.unit)),
            simd.store(simd.narrow(z, c, self.unit)),
        ]
    }

    /// Returns two limits of squared distances: below the first, a point is certainly within `distance`; above the
    /// second, certainly not.
    #[inline(always)]
    pub fn limits(&self, distance: f64) -> (f32, f32) {
        let limit = (distance * self.unit).powi(2);
        ((limit - f64::from(self.rounding)) as f32, (limit + f64::from(self.rounding)) as f32)
    }
}
