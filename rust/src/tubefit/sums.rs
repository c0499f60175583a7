//! What points on one span add to the normal equations.
//!
//! A residual's derivatives by the four control points are −B_a n, n the outward normal, and by the view's rotation and
//! translation and by the radius −1 times the features' first seven, so all sums are products of a few numbers of each
//! point. They are added up in single precision, over few points, and in double precision from there on.

use crate::lanes::{LANES, Lanes};

/// Features of a point: rotation, translation and radius, then the residual.
pub(super) const RESIDUAL: usize = 7;
/// Pairs of the four control points of a span, and of x, y and z.
const PAIRS: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];
const AXES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Eight points on a span.
pub(super) struct Features {
    /// Parameter within the span.
    pub(super) t: Lanes,
    pub(super) weight: Lanes,
    pub(super) outward: [Lanes; 3],
    /// Derivatives by the pose.
    pub(super) turn: [Lanes; 3],
    pub(super) settled: [Lanes; 3],
    /// Metres.
    pub(super) residual: Lanes,
}

/// Sums over points of one view on one span.
pub(super) struct SpanSums {
    pub(super) curve: usize,
    /// The first of the span's four control points.
    pub(super) first: usize,
    /// Points that have a part.
    pub(super) used: usize,
    /// Σ w B_a B_b n nᵀ, for the pairs of control points, and of axes.
    band: [Lanes; PAIRS.len()],
    /// Σ w B_a n_k f, for each control point and axis.
    border: [[Lanes; 3]; 4],
    /// Σ w f_i f.
    corner: [Lanes; RESIDUAL],
}

impl SpanSums {
    pub(super) fn new(curve: usize, first: usize) -> Self {
        let zero = Lanes::all(0.0);
        Self {
            curve,
            first,
            used: 0,
            band: [zero; PAIRS.len()],
            border: [[zero; 3]; 4],
            corner: [zero; RESIDUAL],
        }
    }

    /// Adds eight points; those without weight add nothing.
    #[inline(always)]
    pub(super) fn add(&mut self, points: &Features) {
        let [zero, one, sixth] = [0.0, 1.0, 1.0 / 6.0].map(Lanes::all);
        let t = points.t;
        let s = one - t;
        let [three, four, six] = [3.0, 4.0, 6.0].map(Lanes::all);
        let basis = [
            s * s * s * sixth,
            (three * t * t * t - six * t * t + four) * sixth,
            (three * s * s * s - six * s * s + four) * sixth,
            t * t * t * sixth,
        ];
        let n = points.outward;
        let features = [
            points.turn[0],
            points.turn[1],
            points.turn[2],
            points.settled[0],
            points.settled[1],
            points.settled[2],
            zero - one,
            points.residual,
        ];
        let weighted = basis.map(|b| b * points.weight);
        let pairs = PAIRS.map(|(a, b)| weighted[a] * basis[b]);
        let normals = AXES.map(|(k, l)| n[k] * n[l]);
        let by_point = turned(features);
        let normals_by_point =
            turned(std::array::from_fn(|i| if i < AXES.len() { normals[i] } else { zero }));
        // few sums at a time, so that they stay in registers
        let mut band = self.band;
        for l in 0..LANES {
            for (sum, pair) in band.iter_mut().zip(&pairs) {
                *sum += Lanes::all(pair.0[l]) * normals_by_point[l];
            }
        }
        self.band = band;
        let mut border = self.border;
        for l in 0..LANES {
            let along = n.map(|n| Lanes::all(n.0[l]) * by_point[l]);
            for (sums, b) in border.iter_mut().zip(&weighted) {
                for (sum, along) in sums.iter_mut().zip(along) {
                    *sum += Lanes::all(b.0[l]) * along;
                }
            }
        }
        self.border = border;
        let mut corner = self.corner;
        for l in 0..LANES {
            for (sum, feature) in corner.iter_mut().zip(&features) {
                *sum += Lanes::all(points.weight.0[l] * feature.0[l]) * by_point[l];
            }
        }
        self.corner = corner;
        self.used += points.weight.0.iter().filter(|&&weight| weight > 0.0).count();
    }

    /// Calls `add` with each entry of the 12 x 12 sums of the control points' coordinates, on and below the diagonal.
    #[inline(always)]
    pub(super) fn visit_band(&self, mut add: impl FnMut(usize, usize, f64)) {
        for (sum, (a, b)) in self.band.iter().zip(PAIRS) {
            for (x, (k, l)) in sum.0.iter().zip(AXES) {
                add(3 * b + l, 3 * a + k, f64::from(*x));
                if k != l && a != b {
                    add(3 * b + k, 3 * a + l, f64::from(*x));
                }
            }
        }
    }

    /// Sums of a control point's coordinate with all features.
    #[inline(always)]
    pub(super) fn border(&self, row: usize) -> [f64; LANES] {
        self.border[row / 3][row % 3].0.map(f64::from)
    }

    /// Sums of a feature with all features.
    #[inline(always)]
    pub(super) fn corner(&self, feature: usize) -> [f64; LANES] {
        self.corner[feature].0.map(f64::from)
    }
}

/// Row i of eight rows becomes the i-th entry of each.
#[inline(always)]
fn turned(rows: [Lanes; LANES]) -> [Lanes; LANES] {
    let mut columns = rows;
    for i in 0..LANES {
        for l in 0..LANES {
            columns[l].0[i] = rows[i].0[l];
        }
    }
    columns
}
