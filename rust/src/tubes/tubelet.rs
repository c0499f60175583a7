//! A short piece of tube fitted to oriented points.

use nalgebra::{Matrix6, Vector6};

use crate::geometry::{Point, advance, cross, dot, normalized, sub};
use crate::simd::{Eight, LANES, Lanes, Simd, Three, kernel};

const NOISE: f64 = 0.25; // standard deviation of the points' distances, which weighs them against the priors, radii

const TYPICAL_BLOCKS: usize = 64; // blocks for which a patch reserves memory

/// A piece of a bent tube with the axis c + a τ + ½ a² κ, where |a| is at most its half length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tubelet {
    /// c, metres.
    pub center: Point,
    /// τ, a unit vector.
    pub tangent: Point,
    /// κ, the curvature vector, 1/m, perpendicular to τ.
    pub curvature: Point,
}

/// Eight points of a patch, coordinate by coordinate.
#[derive(Debug, Clone, Copy)]
struct Block {
    /// Positions relative to the patch's origin, radii.
    position: [Lanes; 3],
    /// Unit vectors to the cameras.
    to_camera: [Lanes; 3],
}

/// Points near a place, with the unit vectors to the cameras that saw them.
///
/// Coordinates are in single precision, relative to the place and in radii: their rounding is far below any noise.
#[derive(Debug)]
pub struct Patch {
    origin: Point,
    radius: f64,
    inverse: f64,
    blocks: Vec<Block>,
    /// The number of points in the last block; its other lanes are out of every tubelet's reach.
    filled: usize,
}

impl Patch {
    /// Makes an empty patch around a place, for tubes of a radius.
    pub fn new(origin: Point, radius: f64) -> Self {
        Self {
            origin,
            radius,
            inverse: 1.0 / radius,
            blocks: Vec::with_capacity(TYPICAL_BLOCKS),
            filled: LANES,
        }
    }

    /// Adds a point and the unit vector to its camera.
    #[inline]
    pub fn push(&mut self, point: Point, to_camera: Point) {
        if self.filled == LANES {
            self.blocks.push(Block { position: [Lanes::all(1e3); 3], to_camera: [Lanes::all(0.0); 3] });
            self.filled = 0;
        }
        if let Some(block) = self.blocks.last_mut() {
            for k in 0..3 {
                block.position[k].0[self.filled] = ((point[k] - self.origin[k]) * self.inverse) as f32;
                block.to_camera[k].0[self.filled] = to_camera[k] as f32;
            }
        }
        self.filled += 1;
    }

    /// Counts the points on the surface of a tubelet that face their cameras, within a radius ahead of its centre.
    pub fn support_ahead(&self, tubelet: &Tubelet) -> f64 {
        support_ahead(self, tubelet)
    }
}

kernel! {
    fn support_ahead<S>(simd, patch: &Patch, tubelet: &Tubelet) -> f64 {
        let axis = Axis::of(simd, tubelet, patch);
        let (zero, one) = (simd.splat8(0.0), simd.splat8(1.0));
        let mut count = zero;
        for block in &patch.blocks {
            let (along, distance, outward) = axis.offset(simd, block);
            let ahead = zero.below(along) * along.below(one);
            let on_surface = (distance - one).abs().below(simd.splat8(0.4));
            let facing = zero.below(outward.dot(Three::load(simd, &block.to_camera)));
            count = count + ahead * on_surface * facing;
        }
        count.sum()
    }
}

/// A tubelet in a patch's coordinates, in radii and single precision.
struct Axis<V> {
    center: Three<V>,
    tangent: Three<V>,
    curvature: Three<V>,
}

impl<V: Eight> Axis<V> {
    #[inline(always)]
    fn of(simd: impl Simd<Eight = V>, tubelet: &Tubelet, patch: &Patch) -> Self {
        Self {
            center: Three::all(simd, sub(tubelet.center, patch.origin).map(|x| (x / patch.radius) as f32)),
            tangent: Three::all(simd, tubelet.tangent.map(|x| x as f32)),
            curvature: Three::all(simd, tubelet.curvature.map(|x| (x * patch.radius) as f32)),
        }
    }

    /// Returns the points' distances along the axis and from it, and the unit vectors from the axis to them.
    #[inline(always)]
    fn offset(&self, simd: impl Simd<Eight = V>, block: &Block) -> (V, V, Three<V>) {
        let x = Three::load(simd, &block.position) - self.center;
        let along = x.dot(self.tangent);
        let q = x - self.tangent * along - self.curvature * (simd.splat8(0.5) * along * along);
        let distance = q.dot(q).sqrt().max(simd.splat8(f32::MIN_POSITIVE));
        (along, distance, q * (simd.splat8(1.0) / distance))
    }
}

/// The points that support a tubelet.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Support {
    /// The sum of the inliers' weights less the number of points inside the tube.
    pub score: f64,
    /// The number of points on the tube's surface that face their cameras.
    pub inliers: usize,
    /// The number of points inside the tube.
    pub inside: usize,
}

/// Settings of a tubelet's fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Freedom {
    /// Points up to this distance along the axis take part, radii.
    pub half_length: f64,
    /// Tukey's limit for the distance from the surface, radii.
    pub band: f64,
    /// Gauss–Newton steps.
    pub steps: usize,
    /// Standard deviations of the prior on the whole change: offset in radii, tilt in radians, bend (curvature times
    /// radius); 0 fixes it.
    pub prior: [f64; 3],
}

/// Returns two unit vectors that form a right-handed frame with a unit vector.
pub fn make_frame(t: Point) -> (Point, Point) {
    let helper = if t[2].abs() < 0.8 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let f = normalized(cross(t, helper));
    (f, cross(t, f))
}

impl Tubelet {
    /// Returns the tubelet a step further along.
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

    /// Returns the same tubelet in the opposite direction.
    pub fn reversed(&self) -> Self {
        Self { tangent: self.tangent.map(|x| -x), ..*self }
    }
}

/// Weighted sums of a Gauss–Newton step, in radii. A residual's derivatives are −(1, a, ½a²) ⊗ (e·f₁, e·f₂), so the
/// normal matrix consists of moments of a.
struct Sums {
    /// Σ w aⁿ (p₁², p₁p₂, p₂²) for n from 0 to 4, p = e·f.
    moments: [[f64; 3]; 5],
    /// Σ w (d − 1) aⁿ (p₁, p₂) for n from 0 to 2.
    right: [[f64; 2]; 3],
    support: Support,
}

kernel! {
    /// Sums at a tubelet, where f₁ and f₂ are `across`.
    fn gather<S>(simd, patch: &Patch, tubelet: &Tubelet, across: [Point; 2], freedom: &Freedom) -> Sums {
        add_up::<S, 5>(simd, patch, tubelet, across, freedom)
    }
}

kernel! {
    /// Sums at a tubelet that does not bend: moments up to the second.
    fn gather_straight<S>(simd, patch: &Patch, tubelet: &Tubelet, across: [Point; 2], freedom: &Freedom) -> Sums {
        add_up::<S, 3>(simd, patch, tubelet, across, freedom)
    }
}

kernel! {
    /// Returns how well a tubelet explains a patch.
    fn support<S>(simd, patch: &Patch, tubelet: &Tubelet, freedom: &Freedom) -> Support {
        add_up::<S, 0>(simd, patch, tubelet, [[0.0; 3]; 2], freedom).support
    }
}

/// Sums over a patch, with the first `MOMENTS` moments.
#[inline(always)]
fn add_up<S: Simd, const MOMENTS: usize>(
    simd: S,
    patch: &Patch,
    tubelet: &Tubelet,
    across: [Point; 2],
    freedom: &Freedom,
) -> Sums {
    let axis = Axis::of(simd, tubelet, patch);
    let g1 = Three::all(simd, across[0].map(|x| x as f32));
    let g2 = Three::all(simd, across[1].map(|x| x as f32));
    let (zero, one) = (simd.splat8(0.0), simd.splat8(1.0));
    let (reach, band) = (simd.splat8(freedom.half_length as f32), simd.splat8(freedom.band as f32));
    let narrow = one / band;
    let mut moments = [[zero; 3]; 5];
    let mut right = [[zero; 2]; 3];
    let (mut score, mut inliers, mut inside) = (zero, zero, zero);
    for block in &patch.blocks {
        let (along, distance, outward) = axis.offset(simd, block);
        let facing = outward.dot(Three::load(simd, &block.to_camera));
        let residual = distance - one;
        let near = along.abs().below(reach);
        let turned = distance.below(simd.splat8(0.8)) * facing.below(simd.splat8(-0.2));
        inside = inside + near * distance.below(simd.splat8(0.45)).max(turned);
        let inlier = near * simd.splat8(-0.05).below(facing) * residual.abs().below(band);
        inliers = inliers + inlier;
        let relative = residual * narrow;
        let share = one - relative * relative;
        let mut power = inlier * share * share;
        score = score + power;
        if MOMENTS == 0 {
            continue;
        }
        let (p1, p2) = (outward.dot(g1), outward.dot(g2));
        let products = [p1 * p1, p1 * p2, p2 * p2];
        for n in 0..MOMENTS {
            for k in 0..3 {
                moments[n][k] = moments[n][k] + power * products[k];
            }
            // the right-hand side has the factors 1, a and ½a²; the last only if the tube bends
            if n < MOMENTS.div_ceil(2) {
                right[n][0] = right[n][0] + power * residual * p1;
                right[n][1] = right[n][1] + power * residual * p2;
            }
            power = power * along;
        }
    }
    let inside = inside.sum();
    let support =
        Support { score: score.sum() - inside, inliers: inliers.sum() as usize, inside: inside as usize };
    let mut sums = Sums { moments: [[0.0; 3]; 5], right: [[0.0; 2]; 3], support };
    for n in 0..MOMENTS {
        for k in 0..3 {
            sums.moments[n][k] = moments[n][k].sum();
        }
    }
    for n in 0..MOMENTS.div_ceil(2) {
        for k in 0..2 {
            sums.right[n][k] = right[n][k].sum();
        }
    }
    sums
}

/// Fits a tubelet of a known radius to the points of a patch that face their cameras.
///
/// It minimises the Tukey loss of d − r, where d is a point's distance from the axis, with a prior around the start.
pub fn fit(patch: &Patch, start: Tubelet, freedom: &Freedom) -> (Tubelet, Support) {
    let radius = patch.radius;
    let mut tubelet = start;
    let length = |value: [f64; 2]| (value[0] * value[0] + value[1] * value[1]).sqrt();
    let precision = freedom.prior.map(|sd| if sd > 0.0 { (NOISE / sd).powi(2) } else { f64::INFINITY });
    // tilt and bend so far; the offset so far follows from the centre
    let mut changed = [[0.0; 2]; 3];
    for _ in 0..freedom.steps {
        let (f1, f2) = make_frame(tubelet.tangent);
        let bends = freedom.prior[2] > 0.0;
        let sums = if bends { gather } else { gather_straight }(patch, &tubelet, [f1, f2], freedom);
        if sums.support.inliers < 4 {
            return (tubelet, sums.support);
        }
        let moved = sub(tubelet.center, start.center);
        changed[0] = [dot(moved, f1) / radius, dot(moved, f2) / radius];
        let Some(step) = solve(&sums, &precision, &changed) else { break };
        let limit = |value: [f64; 2], most: f64| {
            let size = length(value);
            if size > most { value.map(|x| x * most / size) } else { value }
        };
        let step = [limit(step[0], 0.4), limit(step[1], 0.3), step[2]];
        for i in 1..3 {
            for k in 0..2 {
                changed[i][k] += step[i][k];
            }
        }
        let along =
            |value: [f64; 2]| -> Point { std::array::from_fn(|k| value[0] * f1[k] + value[1] * f2[k]) };
        tubelet.center = advance(tubelet.center, radius, along(step[0]));
        tubelet.tangent = normalized(advance(tubelet.tangent, 1.0, along(step[1])));
        let bent = advance(tubelet.curvature, 1.0 / radius, along(step[2]));
        tubelet.curvature = advance(bent, -dot(bent, tubelet.tangent), tubelet.tangent);
        if length(step[0]) < 1e-2 && length(step[1]) < 1e-2 {
            break;
        }
    }
    (tubelet, support(patch, &tubelet, freedom))
}

/// Solves one Gauss–Newton step in offset, tilt and bend, each along f₁ and f₂.
fn solve(sums: &Sums, precision: &[f64; 3], changed: &[[f64; 2]; 3]) -> Option<[[f64; 2]; 3]> {
    // factors of 1, a and ½a²
    const FACTORS: [f64; 3] = [1.0, 1.0, 0.5];
    let mut matrix = Matrix6::<f64>::zeros();
    let mut right = Vector6::<f64>::zeros();
    for i in 0..3 {
        for k in 0..2 {
            let row = 2 * i + k;
            if precision[i].is_infinite() {
                matrix[(row, row)] = 1.0;
                continue;
            }
            for j in (0..3).filter(|&j| precision[j].is_finite()) {
                for l in 0..2 {
                    matrix[(row, 2 * j + l)] = FACTORS[i] * FACTORS[j] * sums.moments[i + j][k + l];
                }
            }
            matrix[(row, row)] += precision[i];
            right[row] = FACTORS[i] * sums.right[i][k] - precision[i] * changed[i][k];
        }
    }
    let step = matrix.cholesky()?.solve(&right);
    Some([[step[0], step[1]], [step[2], step[3]], [step[4], step[5]]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns 2025 points of half a tube of radius 1, bent about the y axis with radius 8, seen along z.
    fn half_tube(camera: f64) -> Patch {
        let mut patch = Patch::new([0.0; 3], 1.0);
        for i in -40..=40 {
            for j in 0..=24 {
                let (turn, angle) = (f64::from(i) * 0.01, f64::from(j) / 24.0 * std::f64::consts::PI);
                let out = 8.0 + angle.cos();
                let p = [out * turn.sin(), out * turn.cos() - 8.0, angle.sin()];
                patch.push(p, [0.0, 0.0, camera]);
            }
        }
        patch
    }

    #[test]
    fn a_fit_finds_axis_direction_and_bend() {
        let start =
            Tubelet { center: [0.0, 0.25, 0.2], tangent: normalized([1.0, 0.15, -0.1]), curvature: [0.0; 3] };
        let freedom = Freedom { half_length: 1.5, band: 0.8, steps: 20, prior: [1.0, 1.0, 1.0] };
        let (tubelet, support) = fit(&half_tube(1.0), start, &freedom);
        assert!(dot(tubelet.center, tubelet.center).sqrt() < 0.02, "{tubelet:?}");
        assert!(tubelet.tangent[0] > 0.999, "{tubelet:?}");
        assert!((tubelet.curvature[1] + 0.125).abs() < 0.03, "{tubelet:?}");
        assert!(support.inside == 0 && support.inliers > 500);
        assert!(support.score > 0.98 * support.inliers as f64);
    }

    #[test]
    fn points_that_turn_away_from_their_camera_do_not_count() {
        let start = Tubelet { center: [0.0; 3], tangent: [1.0, 0.0, 0.0], curvature: [0.0; 3] };
        let freedom = Freedom { half_length: 1.5, band: 0.8, steps: 0, prior: [1.0, 1.0, 0.0] };
        assert!(fit(&half_tube(-1.0), start, &freedom).1.inliers < 200);
    }
}
