//! How a rope may have moved since the last frame, and the step that agrees best with that and with the images.

use super::openings::Table;
use super::rope::{Rope, SAMPLES, SUPPORT, Weights, length};
use crate::geometry::Point;
use crate::geometry::bordered::{Bordered, Factor};
use crate::geometry::{dot, normalized, sub};

/// Symmetric 3x3 matrix: xx, yx, yy, zx, zy, zz.
pub type Lower = [f64; 6];

const SMOOTH_SD: f64 = 0.06; // radii: second differences of the displacement, without motion
const SMOOTH_MOVED: f64 = 0.12; // of the way that the fastest node moves in a frame
const STRETCH: f64 = 4.0; // times as large for first differences
const BEND_SD: f64 = 0.1; // radii: third differences of the shape
const BEND_LOOSE: f64 = 3.0; // deviations of them that count half
const END_BEND_SD: f64 = 0.5; // radii: second differences of the shape at the ends, which carry no moment
const EDGE_SD: f64 = 0.02; // of the spacing: lengths between nodes
const LAST_SD: f64 = 10.0; // radii: of the pull to where a node was last seen
const LAST_FROM: f64 = 12.0; // radii from the nearest node that is seen: where that pull begins
const TABLE_SD: f64 = 0.4; // radii: depth in the table
const MOST_STEP: f64 = 8.0; // radii that a node moves in a step
const RIDGE: f64 = 1e-6; // 1/m²
const HIDDEN_MIDDLE: usize = 3; // nodes
const FREE: f64 = 0.02; // weight of the prediction where a rope was laid anew
const FREE_SMOOTH: f64 = 3.0; // times as large differences there

/// What the prediction says of one rope.
pub struct Prior {
    pub base: Vec<Point>,
    /// Standard deviation of each node across the rope, metres.
    pub sd: Vec<f64>,
    /// Standard deviation of sliding along itself, metres.
    pub slack: f64,
    /// The way of the fastest node in a frame, metres.
    pub moved: f64,
    /// The way of the worst predicted node, metres.
    pub surprise: f64,
    /// Nodes that were hidden in the last frame, and their distance along the rope from one that was seen, metres.
    pub hidden: Vec<Option<f64>>,
    pub last: Vec<Point>,
    /// Whether the rope was laid anew, so that the prediction says little.
    pub free: bool,
}

impl Prior {
    /// Tells whether nodes between others that were seen were hidden.
    pub fn hides_middle(&self) -> bool {
        let first = self.hidden.iter().position(Option::is_none).unwrap_or(0);
        let last = self.hidden.iter().rposition(Option::is_none).unwrap_or(0);
        self.hidden[first..=last].iter().flatten().count() >= HIDDEN_MIDDLE
    }
}

/// The normal equations of a rope's nodes.
pub struct Equations {
    matrix: Bordered,
    right: Vec<f64>,
}

impl Equations {
    pub fn new(count: usize) -> Self {
        Self { matrix: Bordered::zeros(3 * count, 0), right: vec![0.0; 3 * count] }
    }

    /// Adds information and its product with a residual at a place of the rope.
    pub fn add_place(&mut self, weights: &Weights, information: &Lower, product: Point) {
        for a in 0..SUPPORT {
            let wa = weights.value[a];
            if wa == 0.0 {
                continue;
            }
            for k in 0..3 {
                self.right[3 * (weights.start + a) + k] += wa * product[k];
            }
            for b in 0..=a {
                let w = wa * weights.value[b];
                self.add_block(weights.start + a, weights.start + b, information, w);
            }
        }
    }

    /// Adds a multiple of a symmetric 3x3 matrix for nodes i ≥ j.
    fn add_block(&mut self, i: usize, j: usize, m: &Lower, w: f64) {
        const FULL: [[usize; 3]; 3] = [[0, 1, 3], [1, 2, 4], [3, 4, 5]];
        for p in 0..3 {
            for q in 0..if i == j { p + 1 } else { 3 } {
                self.matrix.add_band(3 * i + p, 3 * j + q, w * m[FULL[p][q]]);
            }
        }
    }

    fn add_product(&mut self, node: usize, product: Point) {
        for k in 0..3 {
            self.right[3 * node + k] += product[k];
        }
    }

    /// Adds Σ |Σ c_k x_{i+k} − target_i|² / sd², given the current values of these sums minus their targets.
    fn add_differences(&mut self, stencil: &[f64], values: &[Point], weight: f64) {
        for (i, value) in values.iter().enumerate() {
            self.add_differences_at(i, stencil, *value, weight);
        }
    }

    fn add_differences_at(&mut self, i: usize, stencil: &[f64], value: Point, weight: f64) {
        for (a, ca) in stencil.iter().enumerate() {
            self.add_product(i + a, value.map(|x| -weight * ca * x));
            for (b, cb) in stencil[..=a].iter().enumerate() {
                let w = weight * ca * cb;
                for k in 0..3 {
                    self.matrix.add_band(3 * (i + a) + k, 3 * (i + b) + k, w);
                }
            }
        }
    }

    /// Adds what is known without images.
    pub fn add_prior(&mut self, rope: &Rope, prior: &Prior, tangents: &[Point], table: Option<Table>) {
        let (count, r) = (rope.len(), rope.radius);
        let free = if prior.free { FREE } else { 1.0 };
        let moved: Vec<Point> = (0..count).map(|i| sub(rope.nodes[i], prior.base[i])).collect();
        for i in 0..count {
            let across = free / prior.sd[i].powi(2);
            let along = free / (prior.sd[i].powi(2) + count as f64 * prior.slack.powi(2));
            let t = tangents[i];
            let m = add_outer(scaled_identity(across), t, along - across);
            self.add_block(i, i, &m, 1.0);
            self.add_product(i, multiply(&m, moved[i]).map(|x| -x));
        }
        let sd = (SMOOTH_SD * r + SMOOTH_MOVED * prior.moved) * if prior.free { FREE_SMOOTH } else { 1.0 };
        self.add_differences(&[1.0, -2.0, 1.0], &difference(&moved, 2), 1.0 / (sd * sd));
        self.add_differences(&[-1.0, 1.0], &difference(&moved, 1), 1.0 / (STRETCH * sd).powi(2));
        let bends = difference(&rope.nodes, 3);
        for (i, bend) in bends.iter().enumerate() {
            // a rope bends evenly but for a few places
            let squared = dot(*bend, *bend) / (BEND_SD * r).powi(2);
            let w = 1.0 / ((BEND_SD * r).powi(2) * (1.0 + squared / (BEND_LOOSE * BEND_LOOSE)));
            self.add_differences_at(i, &[-1.0, 3.0, -3.0, 1.0], *bend, w);
        }
        let curves = difference(&rope.nodes, 2);
        for i in [0, count - 3] {
            self.add_differences_at(i, &[1.0, -2.0, 1.0], curves[i], 1.0 / (END_BEND_SD * r).powi(2));
        }
        for i in 0..count {
            if let Some(far) = prior.hidden[i] {
                let share = (far / (LAST_FROM * r) - 1.0).clamp(0.0, 1.0);
                let w = share / (LAST_SD * r).powi(2);
                self.add_block(i, i, &scaled_identity(w), 1.0);
                self.add_product(i, sub(rope.nodes[i], prior.last[i]).map(|x| -w * x));
            }
        }
        self.add_lengths(rope);
        if let Some(table) = table {
            for i in 0..count {
                let height = dot(rope.nodes[i], table.normal) - table.offset - r;
                if height < 0.0 {
                    let w = 1.0 / (TABLE_SD * r).powi(2);
                    self.add_block(i, i, &add_outer([0.0; 6], table.normal, w), 1.0);
                    self.add_product(i, table.normal.map(|x| -w * height * x));
                }
            }
        }
        for hold in &rope.holds {
            let weights = Weights::new(hold.at, count);
            let w = 1.0 / hold.sd.powi(2);
            let off = sub(hold.point, weights.place(&rope.nodes));
            self.add_place(&weights, &scaled_identity(w), off.map(|x| w * x));
        }
        for i in 0..3 * count {
            self.matrix.add_band(i, i, RIDGE);
        }
    }

    /// Adds the lengths between nodes: a chord of an arc that turns by θ is shorter than the arc by θ²/24.
    fn add_lengths(&mut self, rope: &Rope) {
        let weight = 1.0 / (EDGE_SD * rope.spacing).powi(2);
        let edges: Vec<Point> = rope.nodes.windows(2).map(|pair| sub(pair[1], pair[0])).collect();
        let units: Vec<Point> = edges.iter().map(|&edge| normalized(edge)).collect();
        for (i, (edge, unit)) in edges.iter().zip(&units).enumerate() {
            let before = units[i.saturating_sub(1)];
            let after = units[(i + 1).min(units.len() - 1)];
            let turn = 0.5 * length(sub(after, before));
            let chord = rope.spacing / (1.0 + turn * turn / 24.0);
            let long = length(*edge);
            let loose = 0.02 * (1.0 - chord / long.max(1e-9)).clamp(0.0, 1.0);
            let mut m = add_outer([0.0; 6], *unit, weight);
            for k in [0, 2, 5] {
                m[k] += weight * loose;
            }
            let pull = unit.map(|x| weight * (chord - long) * x);
            self.add_block(i, i, &m, 1.0);
            self.add_block(i + 1, i + 1, &m, 1.0);
            self.add_block(i + 1, i, &m, -1.0);
            self.add_product(i + 1, pull);
            self.add_product(i, pull.map(|x| -x));
        }
    }

    /// Moves the nodes by a step; returns the factored matrix, or None if it is not positive definite.
    pub fn step(self, rope: &mut Rope) -> Option<Factor> {
        let factor = self.matrix.factor()?;
        let (moves, _) = factor.solve(&self.right, &[]);
        for (node, by) in rope.nodes.iter_mut().zip(moves.as_chunks::<3>().0) {
            let share = (MOST_STEP * rope.radius / length(*by).max(1e-12)).min(1.0);
            for k in 0..3 {
                node[k] += share * by[k];
            }
        }
        Some(factor)
    }
}

/// Returns unit tangents at the nodes.
pub fn find_tangents(nodes: &[Point]) -> Vec<Point> {
    (0..nodes.len()).map(|i| normalized(Weights::new(i as f64, nodes.len()).direction(nodes))).collect()
}

fn difference(values: &[Point], order: usize) -> Vec<Point> {
    let mut now = values.to_vec();
    for _ in 0..order {
        now = now.windows(2).map(|pair| sub(pair[1], pair[0])).collect();
    }
    now
}

pub fn scaled_identity(w: f64) -> Lower {
    [w, 0.0, w, 0.0, 0.0, w]
}

/// Returns m + w d dᵀ.
pub fn add_outer(m: Lower, d: Point, w: f64) -> Lower {
    [
        m[0] + w * d[0] * d[0],
        m[1] + w * d[1] * d[0],
        m[2] + w * d[1] * d[1],
        m[3] + w * d[2] * d[0],
        m[4] + w * d[2] * d[1],
        m[5] + w * d[2] * d[2],
    ]
}

pub fn multiply(m: &Lower, x: Point) -> Point {
    [
        m[0] * x[0] + m[1] * x[1] + m[3] * x[2],
        m[1] * x[0] + m[2] * x[1] + m[4] * x[2],
        m[3] * x[0] + m[4] * x[1] + m[5] * x[2],
    ]
}

/// Lists the covariances of the nodes.
pub fn list_covariances(factor: &Factor, count: usize) -> Vec<[Point; 3]> {
    let (band, _) = factor.inverse();
    let width = band.first().map_or(0, |row| row.len());
    let entry = |i: usize, j: usize| band[i.max(j)][i.min(j) + width - 1 - i.max(j)];
    (0..count).map(|n| [0, 1, 2].map(|p| [0, 1, 2].map(|q| entry(3 * n + p, 3 * n + q)))).collect()
}

/// Samples of one node.
pub const SAMPLES_A_NODE: f64 = SAMPLES as f64;
