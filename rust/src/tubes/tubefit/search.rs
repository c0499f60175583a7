//! The search for the place on the curves that explains a point best.

use rustc_hash::FxHashMap;

use super::input::{OnCurve, Residual};
use super::state::State;
use crate::geometry::{Point, cell_of, dot, normalized, sub};
use crate::simd::{Eight, LANES, Lanes, Simd, Three, find_least, kernel};

const SAMPLING: f64 = 0.5; // distance between the samples of a curve, radii
const REACH: f64 = 2.0; // largest distance of a point from an axis that it belongs to, radii

/// Samples of all curves, listed for each cell of space that has some within reach.
pub(super) struct Search {
    cell: f64,
    /// The blocks of each cell.
    cells: FxHashMap<[i64; 3], std::ops::Range<usize>>,
    blocks: Vec<Block>,
    /// Square of the distance within which samples count, m².
    reach: f32,
    /// Least cosine between normal and camera; points that turn away more lie on the far side of a tube.
    least_facing: f32,
}

/// Eight samples, metres relative to the middle of their cell; unused lanes are out of reach.
#[derive(Clone)]
struct Block {
    position: [Lanes; 3],
    tangent: [Lanes; 3],
    radius: Lanes,
    places: [OnCurve; LANES],
}

impl Search {
    pub(super) fn new(state: &State, residual: Residual) -> Self {
        let reach = REACH * state.radii.iter().copied().fold(0.0, f64::max);
        let cell = 2.0 * reach;
        let mut samples = Vec::new();
        let mut numbers: FxHashMap<[i64; 3], usize> = FxHashMap::default();
        let mut lists: Vec<([i64; 3], Vec<usize>)> = Vec::new();
        // neighbouring samples mostly reach into the same cells
        let (mut corners, mut reached) = ([[i64::MAX; 3]; 2], Vec::new());
        for (curve, spline) in state.curves.iter().enumerate() {
            for parameter in spline.parameters(SAMPLING * state.radius(curve)) {
                let place = spline.at(parameter);
                let now = [-reach, reach].map(|by| cell_of(place.position.map(|x| x + by), cell));
                if now != corners {
                    corners = now;
                    let [low, high] = corners;
                    reached.clear();
                    for x in low[0]..=high[0] {
                        for y in low[1]..=high[1] {
                            for z in low[2]..=high[2] {
                                let number = *numbers.entry([x, y, z]).or_insert(lists.len());
                                if number == lists.len() {
                                    lists.push(([x, y, z], Vec::new()));
                                }
                                reached.push(number);
                            }
                        }
                    }
                }
                for &number in &reached {
                    lists[number].1.push(samples.len());
                }
                samples.push((place, state.radius(curve), OnCurve { curve, parameter }));
            }
        }
        let mut cells = FxHashMap::default();
        let mut blocks: Vec<Block> = Vec::new();
        for (of, list) in lists {
            let first = blocks.len();
            let middle = of.map(|x| (x as f64 + 0.5) * cell);
            for numbers in list.chunks(LANES) {
                let mut block = Block {
                    position: [Lanes::all(f32::MAX.sqrt()); 3],
                    tangent: [Lanes::all(0.0); 3],
                    radius: Lanes::all(0.0),
                    places: [OnCurve { curve: 0, parameter: 0.0 }; LANES],
                };
                for (l, &number) in numbers.iter().enumerate() {
                    let (place, radius, on_curve) = &samples[number];
                    let (x, tangent) = (sub(place.position, middle), normalized(place.first));
                    for k in 0..3 {
                        block.position[k].0[l] = x[k] as f32;
                        block.tangent[k].0[l] = tangent[k] as f32;
                    }
                    block.radius.0[l] = *radius as f32;
                    block.places[l] = *on_curve;
                }
                blocks.push(block);
            }
            cells.insert(of, first..blocks.len());
        }
        let least_facing = if residual == Residual::Ray { -0.6 } else { -0.05 };
        Self { cell, cells, blocks, reach: (reach * reach) as f32, least_facing }
    }

    /// Returns the blocks of a cell.
    fn listed(&self, cell: [i64; 3]) -> &[Block] {
        self.cells.get(&cell).map_or(&[], |range| &self.blocks[range.clone()])
    }
}

kernel! {
    /// Finds the places that explain the points of one camera best; None for points without a tube nearby.
    pub(super) fn find_places<S>(simd, search: &Search, points: &[Point], camera: Point) -> Vec<Option<OnCurve>> {
        let mut found = vec![None; points.len()];
        let (mut last, mut blocks) = ([i64::MAX; 3], &search.blocks[..0]);
        for (found, &p) in found.iter_mut().zip(points) {
            let cell = cell_of(p, search.cell);
            if cell != last {
                (last, blocks) = (cell, search.listed(cell));
            }
            if blocks.is_empty() {
                continue;
            }
            let to_camera = sub(camera, p);
            let scale = 1.0 / dot(to_camera, to_camera).sqrt();
            let (mut x, mut direction) = ([0.0; 3], [0.0; 3]);
            for k in 0..3 {
                x[k] = (p[k] - (cell[k] as f64 + 0.5) * search.cell) as f32;
                direction[k] = (to_camera[k] * scale) as f32;
            }
            let (costs, numbers) = find_cheapest(simd, search, blocks, x, direction);
            let (best, least) = find_least(&costs.0);
            if least < f32::MAX {
                *found = Some(blocks[numbers.0[best] as usize].places[best]);
            }
        }
        found
    }
}

/// Returns the least cost in each lane of some blocks, and the number of its block.
#[inline(always)]
fn find_cheapest<S: Simd>(
    simd: S,
    search: &Search,
    blocks: &[Block],
    p: [f32; 3],
    to_camera: [f32; 3],
) -> (Lanes, Lanes) {
    let (p, to_camera) = (Three::all(simd, p), Three::all(simd, to_camera));
    let (zero, worst) = (simd.splat8(0.0), simd.splat8(f32::MAX));
    let (reach, facing) = (simd.splat8(search.reach), simd.splat8(search.least_facing));
    let (mut best, mut number) = (worst, zero);
    let mut i = 0.0;
    for block in blocks {
        let (r, tangent) = (simd.load8(&block.radius), Three::load(simd, &block.tangent));
        let x = p - Three::load(simd, &block.position);
        let along = x.dot(tangent);
        let q = x - tangent * along;
        let d = q.dot(q).sqrt();
        let away = q.dot(to_camera).below(facing * d) * simd.splat8(2.0) * r;
        let cost = (d - r).abs() + away + (along.abs() - simd.splat8(0.3) * r).max(zero);
        let out = reach.below(x.dot(x)).max((simd.splat8(1.2) * r).not_above(cost));
        let cost = out.choose(worst, cost);
        number = cost.below(best).choose(simd.splat8(i), number);
        best = cost.min(best);
        i += 1.0;
    }
    (best.store(), number.store())
}
