//! Sums over points on one span for the normal equations.
//!
//! A residual's derivatives by the four control points are −B_a n, where n is the outward normal. Its derivatives by
//! the view's rotation and translation and by the radius are −1 times the first seven features. So all sums are
//! products of a few numbers of each point. Sums over few points are in single precision; their totals are in double
//! precision.

use crate::simd::{Eight, LANES, Lanes, Simd, Three};

pub(super) const RESIDUAL: usize = 7; // the number of the residual feature, after rotation, translation and the radius
/// Pairs of the four control points of a span.
const PAIRS: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];
const AXES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]; // pairs of x, y and z

/// The sums that are wanted.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// None: only the foot points.
    Nothing,
    /// Those for poses and radii; curves are held.
    Held,
    All,
}

/// Eight points on a span.
pub(super) struct Features<V> {
    /// Parameter within the span.
    pub(super) t: V,
    pub(super) weight: V,
    pub(super) outward: Three<V>,
    /// Derivatives by the pose.
    pub(super) turn: Three<V>,
    pub(super) settled: Three<V>,
    /// Derivative by the radius.
    pub(super) grown: V,
    /// Residual, metres.
    pub(super) residual: V,
}

/// Sums over points of one view on one span.
#[derive(Clone)]
pub(super) struct SpanSums {
    pub(super) curve: usize,
    /// The first of the span's four control points.
    pub(super) first: usize,
    /// The number of points that take part.
    pub(super) used: usize,
    /// Σ w B_a B_b n nᵀ, for pairs of control points and of axes.
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

    /// Adds eight points to the sums, with those for curves if these are fitted; points without weight add nothing.
    #[inline(always)]
    pub(super) fn add<S: Simd>(&mut self, simd: S, points: &Features<S::Eight>, with_curves: bool) {
        let ([r0, r1, r2], [s0, s1, s2]) = (points.turn.0, points.settled.0);
        let features = [r0, r1, r2, s0, s1, s2, points.grown, points.residual];
        let by_point = simd.transpose8(features);
        if with_curves {
            self.add_to_curves(simd, points, &by_point);
        }
        let weight = points.weight.store();
        let mut corner = [simd.splat8(0.0); RESIDUAL];
        let mut weighted = [weight; RESIDUAL];
        for k in 0..RESIDUAL {
            corner[k] = simd.load8(&self.corner[k]);
            weighted[k] = (points.weight * features[k]).store();
        }
        for l in 0..LANES {
            let by_point = simd.load8(&by_point[l]);
            for k in 0..RESIDUAL {
                corner[k] = corner[k] + simd.splat8(weighted[k].0[l]) * by_point;
            }
        }
        for k in 0..RESIDUAL {
            self.corner[k] = corner[k].store();
        }
        for weight in weight.0 {
            self.used += usize::from(weight > 0.0);
        }
    }

    /// Adds eight points, given with their features point by point, to the sums for curves.
    #[inline(always)]
    fn add_to_curves<S: Simd>(&mut self, simd: S, points: &Features<S::Eight>, by_point: &[Lanes; LANES]) {
        let (zero, one, sixth) = (simd.splat8(0.0), simd.splat8(1.0), simd.splat8(1.0 / 6.0));
        let (three, four, six) = (simd.splat8(3.0), simd.splat8(4.0), simd.splat8(6.0));
        let t = points.t;
        let s = one - t;
        let basis = [
            s * s * s * sixth,
            (three * t * t * t - six * t * t + four) * sixth,
            (three * s * s * s - six * s * s + four) * sixth,
            t * t * t * sixth,
        ];
        let n = points.outward.0;
        let weight = points.weight.store();
        let mut weighted = [zero; 4];
        let mut stored = [weight; 4];
        for a in 0..4 {
            weighted[a] = basis[a] * points.weight;
            stored[a] = weighted[a].store();
        }
        let mut pairs = [weight; PAIRS.len()];
        for i in 0..PAIRS.len() {
            let (a, b) = PAIRS[i];
            pairs[i] = (weighted[a] * basis[b]).store();
        }
        let outward = [n[0].store(), n[1].store(), n[2].store()];
        let mut normals = [zero; LANES];
        for i in 0..AXES.len() {
            let (k, l) = AXES[i];
            normals[i] = n[k] * n[l];
        }
        let normals_by_point = simd.transpose8(normals);
        // few sums at a time, so that they stay in registers
        let mut band = [zero; PAIRS.len()];
        for i in 0..PAIRS.len() {
            band[i] = simd.load8(&self.band[i]);
        }
        for l in 0..LANES {
            let normals = simd.load8(&normals_by_point[l]);
            for i in 0..PAIRS.len() {
                band[i] = band[i] + simd.splat8(pairs[i].0[l]) * normals;
            }
        }
        for i in 0..PAIRS.len() {
            self.band[i] = band[i].store();
        }
        let mut border = [[zero; 3]; 4];
        for a in 0..4 {
            for k in 0..3 {
                border[a][k] = simd.load8(&self.border[a][k]);
            }
        }
        for l in 0..LANES {
            let features = simd.load8(&by_point[l]);
            for k in 0..3 {
                let along = simd.splat8(outward[k].0[l]) * features;
                for a in 0..4 {
                    border[a][k] = border[a][k] + simd.splat8(stored[a].0[l]) * along;
                }
            }
        }
        for a in 0..4 {
            for k in 0..3 {
                self.border[a][k] = border[a][k].store();
            }
        }
    }

    /// Adds the sums of the control points to a band.
    #[inline]
    pub(super) fn add_band_to(&self, band: &mut Band) {
        for (totals, sums) in band.0.iter_mut().zip(&self.band) {
            for (total, sum) in totals.iter_mut().zip(sums.0) {
                *total += f64::from(sum);
            }
        }
    }

    /// Returns the sums of a control point's coordinate with all features, times a factor.
    #[inline(always)]
    pub(super) fn border(&self, row: usize, factor: f64) -> [f64; LANES] {
        multiply(&self.border[row / 3][row % 3], factor)
    }

    /// Returns the sums of a feature with all features, times a factor.
    #[inline(always)]
    pub(super) fn corner(&self, feature: usize, factor: f64) -> [f64; LANES] {
        multiply(&self.corner[feature], factor)
    }
}

/// Sums of the control points of a span over all views.
#[derive(Clone, Default)]
pub(super) struct Band([[f64; LANES]; PAIRS.len()]);

impl Band {
    /// Calls `add` with each entry, on and below the diagonal, of the 12 x 12 sums of the control points' coordinates.
    #[inline(always)]
    pub(super) fn visit(&self, mut add: impl FnMut(usize, usize, f64)) {
        for (sums, (a, b)) in self.0.iter().zip(PAIRS) {
            for (&sum, (k, l)) in sums.iter().zip(AXES) {
                add(3 * b + l, 3 * a + k, sum);
                if k != l && a != b {
                    add(3 * b + k, 3 * a + l, sum);
                }
            }
        }
    }
}

#[inline(always)]
fn multiply(lanes: &Lanes, factor: f64) -> [f64; LANES] {
    let mut products = [0.0; LANES];
    for l in 0..LANES {
        products[l] = factor * f64::from(lanes.0[l]);
    }
    products
}
