//! A short piece of tube fitted to oriented points.

use nalgebra::{Matrix6, Vector6};

use crate::Point;
use crate::geometry::{advance, cross, dot, normalized, sub};

/// Standard deviation of the points' distances that weighs them against the priors, in radii.
const NOISE: f64 = 0.25;

/// A piece of a bent tube: its axis is c + a τ + ½ a² κ for |a| up to its half length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tubelet {
    /// c, metres.
    pub center: Point,
    /// τ, a unit vector.
    pub tangent: Point,
    /// κ, the curvature vector, 1/m, at a right angle to τ.
    pub curvature: Point,
}

/// Points near a place, with the unit vectors to the cameras that saw them.
#[derive(Debug, Default)]
pub struct Patch {
    /// Position and direction to the camera of each.
    pub points: Vec<(Point, Point)>,
}

/// How well a tubelet explains a patch.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Support {
    /// Sum of the inliers' weights less the number of points inside the tube.
    pub score: f64,
    /// Points on the tube's surface that face their cameras.
    pub inliers: usize,
    /// Points inside the tube, where matter would be.
    pub inside: usize,
}

/// What a fit may change, and how closely it looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Freedom {
    /// Points up to this far along the axis take part, in radii.
    pub half_length: f64,
    /// Tukey's limit for the distance from the surface, in radii.
    pub band: f64,
    /// Gauss–Newton steps.
    pub steps: usize,
    /// Standard deviations of the prior on the whole change: offset in radii, tilt in radians, bend (curvature
    /// times radius); 0 holds it fixed.
    pub prior: [f64; 3],
}

/// Two unit vectors that make a right-handed frame with a unit vector.
pub fn frame(t: Point) -> (Point, Point) {
    let helper = if t[2].abs() < 0.8 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let f = normalized(cross(t, helper));
    (f, cross(t, f))
}

/// Where a point lies relative to a tubelet.
pub struct Offset {
    /// Distance along the tangent, metres.
    pub along: f64,
    /// Distance from the axis, metres.
    pub distance: f64,
    /// Unit vector from the axis to the point.
    pub outward: Point,
}

impl Tubelet {
    /// Where a point lies.
    #[inline]
    pub fn offset(&self, p: Point) -> Offset {
        let x = sub(p, self.center);
        let along = dot(x, self.tangent);
        let half = 0.5 * along * along;
        let q: Point = std::array::from_fn(|k| x[k] - along * self.tangent[k] - half * self.curvature[k]);
        let distance = dot(q, q).sqrt().max(f64::MIN_POSITIVE);
        Offset { along, distance, outward: q.map(|v| v / distance) }
    }

    /// The tubelet a step further along.
    pub fn ahead(&self, step: f64) -> Self {
        let half = 0.5 * step * step;
        Self {
            center: std::array::from_fn(|k| {
                self.center[k] + step * self.tangent[k] + half * self.curvature[k]
            }),
            tangent: normalized(advance(self.tangent, step, self.curvature)),
            curvature: self.curvature,
        }
    }

    /// The same tubelet, the other way round.
    pub fn reversed(&self) -> Self {
        Self { tangent: self.tangent.map(|x| -x), ..*self }
    }
}

/// Weighted sums of a Gauss–Newton step. A residual's derivatives are −(1, a, ½a²) ⊗ (e·f₁, e·f₂), so the normal
/// matrix is made of the products of the two factors.
#[derive(Default)]
struct Sums {
    matrix: [[f64; 3]; 6],
    right: [[f64; 2]; 3],
    support: Support,
}

/// Pairs of (1, a, ½a²), in the order of `Sums::matrix`.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

fn gather(patch: &Patch, tubelet: &Tubelet, radius: f64, freedom: &Freedom) -> (Sums, Point, Point) {
    let (f1, f2) = frame(tubelet.tangent);
    let (reach, band) = (freedom.half_length * radius, freedom.band * radius);
    let mut sums = Sums::default();
    for &(p, to_camera) in &patch.points {
        let x = sub(p, tubelet.center);
        if dot(x, tubelet.tangent).abs() > reach {
            continue;
        }
        let Offset { along: a, distance: d, outward: e } = tubelet.offset(p);
        let facing = dot(e, to_camera);
        if d < 0.45 * radius || (d < 0.8 * radius && facing < -0.2) {
            sums.support.inside += 1;
        }
        let residual = d - radius;
        if facing < -0.05 || residual.abs() >= band {
            continue;
        }
        let relative = residual / band;
        let weight = (1.0 - relative * relative).powi(2);
        sums.support.inliers += 1;
        sums.support.score += weight;
        let (p1, p2) = (dot(e, f1), dot(e, f2));
        let along = [1.0, a, 0.5 * a * a];
        let across = [weight * p1 * p1, weight * p1 * p2, weight * p2 * p2];
        for (entry, (i, j)) in sums.matrix.iter_mut().zip(PAIRS) {
            let product = along[i] * along[j];
            for k in 0..3 {
                entry[k] += product * across[k];
            }
        }
        for i in 0..3 {
            sums.right[i][0] += weight * residual * along[i] * p1;
            sums.right[i][1] += weight * residual * along[i] * p2;
        }
    }
    sums.support.score -= sums.support.inside as f64;
    (sums, f1, f2)
}

/// Fits a tubelet of a known radius to the points of a patch that face their cameras.
///
/// Minimises the Tukey loss of d − r, d the points' distance from the axis, with a prior about the start.
pub fn fit(patch: &Patch, start: Tubelet, radius: f64, freedom: &Freedom) -> (Tubelet, Support) {
    let mut tubelet = start;
    let scales = [radius, 1.0, 1.0 / radius];
    let precision: [f64; 3] = std::array::from_fn(|i| {
        let sd = freedom.prior[i] * scales[i];
        if sd > 0.0 { (NOISE * radius / sd).powi(2) } else { f64::INFINITY }
    });
    // tilt and bend so far; the offset so far follows from the centre
    let mut changed = [[0.0; 2]; 3];
    for _ in 0..freedom.steps {
        let (sums, f1, f2) = gather(patch, &tubelet, radius, freedom);
        if sums.support.inliers < 4 {
            return (tubelet, sums.support);
        }
        let moved = sub(tubelet.center, start.center);
        changed[0] = [dot(moved, f1), dot(moved, f2)];
        let Some(step) = solve(&sums, &precision, &changed) else { break };
        let limit = |value: [f64; 2], most: f64| {
            let size = value[0].hypot(value[1]);
            if size > most { value.map(|x| x * most / size) } else { value }
        };
        let step = [limit(step[0], 0.4 * radius), limit(step[1], 0.3), step[2]];
        for i in 1..3 {
            for k in 0..2 {
                changed[i][k] += step[i][k];
            }
        }
        let along =
            |value: [f64; 2]| -> Point { std::array::from_fn(|k| value[0] * f1[k] + value[1] * f2[k]) };
        tubelet.center = advance(tubelet.center, 1.0, along(step[0]));
        tubelet.tangent = normalized(advance(tubelet.tangent, 1.0, along(step[1])));
        let bent = advance(tubelet.curvature, 1.0, along(step[2]));
        tubelet.curvature = advance(bent, -dot(bent, tubelet.tangent), tubelet.tangent);
        if step[0][0].hypot(step[0][1]) < 1e-3 * radius && step[1][0].hypot(step[1][1]) < 1e-3 {
            break;
        }
    }
    let support = gather(patch, &tubelet, radius, freedom).0.support;
    (tubelet, support)
}

/// One Gauss–Newton step in offset, tilt and bend, each along f₁ and f₂.
fn solve(sums: &Sums, precision: &[f64; 3], changed: &[[f64; 2]; 3]) -> Option<[[f64; 2]; 3]> {
    let mut matrix = Matrix6::<f64>::zeros();
    for (entry, (i, j)) in sums.matrix.iter().zip(PAIRS) {
        for (r, c, k) in [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)] {
            matrix[(2 * i + r, 2 * j + c)] = entry[k];
            matrix[(2 * j + c, 2 * i + r)] = entry[k];
        }
    }
    let mut right = Vector6::<f64>::zeros();
    for i in 0..3 {
        for k in 0..2 {
            let row = 2 * i + k;
            if precision[i].is_finite() {
                matrix[(row, row)] += precision[i];
                right[row] = sums.right[i][k] - precision[i] * changed[i][k];
            } else {
                matrix.fill_row(row, 0.0);
                matrix.fill_column(row, 0.0);
                matrix[(row, row)] = 1.0;
            }
        }
    }
    let step = matrix.cholesky()?.solve(&right);
    Some([[step[0], step[1]], [step[2], step[3]], [step[4], step[5]]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a tube of radius 1 bent about the y axis with radius 8, seen from above.
    fn half_tube() -> Patch {
        let mut patch = Patch::default();
        for i in -40..=40 {
            for j in 0..=24 {
                let (turn, angle) = (f64::from(i) * 0.01, f64::from(j) / 24.0 * std::f64::consts::PI);
                let out = 8.0 + angle.cos();
                let p = [out * turn.sin(), out * turn.cos() - 8.0, angle.sin()];
                patch.points.push((p, [0.0, 0.0, 1.0]));
            }
        }
        patch
    }

    #[test]
    fn a_fit_finds_axis_direction_and_bend() {
        let start =
            Tubelet { center: [0.0, 0.25, 0.2], tangent: normalized([1.0, 0.15, -0.1]), curvature: [0.0; 3] };
        let freedom = Freedom { half_length: 1.5, band: 0.8, steps: 20, prior: [1.0, 1.0, 1.0] };
        let (tubelet, support) = fit(&half_tube(), start, 1.0, &freedom);
        assert!(dot(tubelet.center, tubelet.center).sqrt() < 0.02, "{tubelet:?}");
        assert!(tubelet.tangent[0] > 0.999, "{tubelet:?}");
        assert!((tubelet.curvature[1] + 0.125).abs() < 0.03, "{tubelet:?}");
        assert!(support.inside == 0 && support.inliers > 500);
        assert!(support.score > 0.98 * support.inliers as f64);
    }

    #[test]
    fn points_that_turn_away_from_their_camera_do_not_count() {
        let mut patch = half_tube();
        for (_, to_camera) in &mut patch.points {
            *to_camera = [0.0, 0.0, -1.0];
        }
        let start = Tubelet { center: [0.0; 3], tangent: [1.0, 0.0, 0.0], curvature: [0.0; 3] };
        let freedom = Freedom { half_length: 1.5, band: 0.8, steps: 0, prior: [1.0, 1.0, 0.0] };
        assert!(fit(&patch, start, 1.0, &freedom).1.inliers < patch.points.len() / 10);
    }
}
