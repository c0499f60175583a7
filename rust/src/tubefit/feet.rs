//! Where points belong: the curve and the place on it that explain each best, and how far from its surface it is.

use rayon::prelude::*;

use super::{Foot, Residual, State, Term, TubeFitOptions};
use crate::Point;
use crate::geometry::{advance, dot, normalized, sub};
use crate::index::Grid;
use crate::spline::{Pieces, Spline};

/// Points whose terms are computed by one task; fixed, so that results do not depend on the number of threads.
const POINTS_PER_TASK: usize = 512;
/// Distance between the places of a curve that points are compared with first, in radii.
const SAMPLING: f64 = 0.5;
/// How far a point may be from an axis to belong to it, in radii.
const REACH: f64 = 2.0;
/// How far to both sides a curve's direction is taken where poses are concerned, in spans.
const STRETCH: f64 = 2.0;
/// At how many places of a span it is taken.
const DIRECTIONS: f64 = 8.0;

/// The foot of a point that no tube is near to.
const NOWHERE: Foot = Foot {
    curve: 0,
    parameter: 0.0,
    residual: f64::INFINITY,
    outward: [0.0; 3],
    facing: 0.0,
    weight: 0.0,
    explained: false,
    inlier: false,
};

impl Foot {
    /// Where it is, if it is anywhere.
    fn place(&self) -> Option<OnCurve> {
        (self.residual < f64::INFINITY).then_some(OnCurve { curve: self.curve, parameter: self.parameter })
    }
}

/// A place of a curve that points are compared with.
#[derive(Clone, Copy)]
struct Sample {
    position: Point,
    tangent: Point,
    radius: f64,
    place: OnCurve,
}

/// A place of one of the curves.
#[derive(Clone, Copy)]
struct OnCurve {
    curve: usize,
    parameter: f64,
}

/// Places along all curves, to find the one that explains a point best.
struct Search {
    grid: Grid,
    /// In the grid's order.
    samples: Vec<Sample>,
    /// Points that turn farther away from their cameras, as a cosine, lie on the far side of a tube.
    least_facing: f64,
}

impl State<'_> {
    /// The feet of all points at the current curves, poses and radius; on the curves that they are known to be on.
    pub(super) fn terms(
        &self,
        options: &TubeFitOptions,
        bands: &[f64],
        known: Option<&[Vec<Term>]>,
    ) -> Vec<Vec<Term>> {
        let search = known.is_none().then(|| Search::new(self, options.residual));
        let directions: Vec<Vec<Point>> = self.curves.iter().map(directions).collect();
        let pieces: Vec<Pieces> = self.curves.iter().map(Spline::pieces).collect();
        let in_view = |view: usize| {
            let motion = &self.motions[view];
            let camera = motion.apply(self.views[view].viewpoint);
            let points = self.views[view].points;
            let term = |i: usize| {
                let moved = motion.apply(points[i]);
                let to_camera = normalized(sub(camera, moved));
                let start = match (&search, known) {
                    (Some(search), _) => search.place(moved, to_camera),
                    (None, known) => known.and_then(|known| known[view][i].foot.place()),
                };
                let Some(start) = start else {
                    return Term { moved, settled: [0.0; 3], foot: NOWHERE };
                };
                let mut foot =
                    self.foot(moved, to_camera, start, &pieces[start.curve], options.residual, bands);
                if options.bounds.is_some_and(|bounds| self.is_cut(&foot, bounds)) {
                    foot.weight = 0.0;
                }
                let along = directions[foot.curve][(foot.parameter * DIRECTIONS).round() as usize];
                let settled = normalized(advance(foot.outward, -dot(foot.outward, along), along));
                Term { moved, settled, foot }
            };
            (0..points.len()).into_par_iter().with_min_len(POINTS_PER_TASK).map(term).collect()
        };
        (0..self.views.len()).into_par_iter().map(in_view).collect()
    }

    /// Whether noise may have carried points out of the extraction range at a foot.
    fn is_cut(&self, foot: &Foot, [low, high]: [Point; 2]) -> bool {
        let axis = self.curves[foot.curve].at(foot.parameter).position;
        let surface = advance(axis, self.radius(foot.curve), foot.outward);
        let margin = 2.0 * self.sigma;
        (0..3).any(|k| surface[k] < low[k] + margin || surface[k] > high[k] - margin)
    }

    /// A point's foot near a place.
    fn foot(
        &self,
        p: Point,
        to_camera: Point,
        start: OnCurve,
        curve: &Pieces,
        residual: Residual,
        bands: &[f64],
    ) -> Foot {
        let r = self.radius(start.curve);
        let band = bands[self.ropes[start.curve]];
        let mut parameter = start.parameter;
        for _ in 0..2 {
            let place = curve.at(parameter);
            let x = sub(p, place.position);
            let square = dot(place.first, place.first);
            let slope = (square - dot(x, place.second)).max(0.3 * square);
            parameter = (parameter + dot(x, place.first) / slope).clamp(0.0, curve.end());
        }
        let place = curve.at(parameter);
        let tangent = normalized(place.first);
        let beyond = dot(sub(p, place.position), tangent);
        let q = advance(sub(p, place.position), -beyond, tangent);
        let d = dot(q, q).sqrt().max(f64::MIN_POSITIVE);
        let foot = Foot { curve: start.curve, parameter, ..NOWHERE };
        if beyond.abs() > 0.02 * r {
            return Foot { residual: d - r, ..foot };
        }
        match residual {
            Residual::Distance => {
                let outward = q.map(|x| x / d);
                let facing = dot(outward, to_camera);
                let explained = facing > 0.1;
                let weight = if explained { tukey(d - r, band) } else { 0.0 };
                let inlier = explained && (d - r).abs() < band;
                Foot { residual: d - r, outward, facing, explained, inlier, weight, ..foot }
            }
            Residual::Ray => along_ray(foot, q, to_camera, tangent, r, band),
        }
    }
}

/// The residual along the viewing ray, with the tube's straight cylinder at the foot.
fn along_ray(foot: Foot, q: Point, to_camera: Point, tangent: Point, r: f64, band: f64) -> Foot {
    // across the axis: the ray is q + λ w, nearest to the axis at λ₀
    let w = advance(to_camera, -dot(to_camera, tangent), tangent);
    let square = dot(w, w) + 1e-12;
    let nearest = -dot(q, w) / square;
    let miss = advance(q, nearest, w);
    let gap = dot(miss, miss);
    if gap >= r * r {
        let residual = gap.sqrt() - r;
        let explained = residual < 0.25 * r;
        return Foot { residual, explained, inlier: explained && residual < band, ..foot };
    }
    let length = nearest + ((r * r - gap) / square).sqrt();
    let outward = normalized(advance(q, length, w));
    let facing = dot(outward, to_camera);
    let residual = -length * facing;
    let cosine = facing.max(0.4);
    let near = length.abs() < 1.2 * r;
    let weight = if near { tukey(residual, band * cosine.max(0.5)) / (cosine * cosine) } else { 0.0 };
    let inlier = residual.abs() < band;
    Foot { residual, outward, facing, explained: true, inlier, weight, ..foot }
}

impl Search {
    fn new(state: &State, residual: Residual) -> Self {
        let curves = &state.curves;
        let sample = |curve: usize, parameter: f64| {
            let place = curves[curve].at(parameter);
            let tangent = normalized(place.first);
            Sample {
                position: place.position,
                tangent,
                radius: state.radius(curve),
                place: OnCurve { curve, parameter },
            }
        };
        let samples: Vec<Sample> = (0..curves.len())
            .flat_map(|curve| {
                let parameters = curves[curve].parameters(SAMPLING * state.radius(curve));
                parameters.into_iter().map(move |parameter| sample(curve, parameter))
            })
            .collect();
        let positions: Vec<Point> = samples.iter().map(|sample| sample.position).collect();
        let grid = Grid::new(&positions, REACH * state.radii.iter().copied().fold(0.0, f64::max));
        let samples = grid.gather(&samples);
        let least_facing = if residual == Residual::Ray { -0.6 } else { -0.05 };
        Self { grid, samples, least_facing }
    }

    /// The place that explains a point best.
    fn place(&self, p: Point, to_camera: Point) -> Option<OnCurve> {
        let mut best = (f64::INFINITY, None);
        self.grid.visit_near(p, |i, position, _| {
            let sample = &self.samples[i];
            let r = sample.radius;
            let x = sub(p, position);
            let along = dot(x, sample.tangent);
            let q = advance(x, -along, sample.tangent);
            let d = dot(q, q).sqrt();
            let away = if dot(q, to_camera) < self.least_facing * d { 2.0 * r } else { 0.0 };
            let cost = (d - r).abs() + away + (along.abs() - 0.3 * r).max(0.0);
            if cost < best.0.min(1.2 * r) {
                best = (cost, Some(sample.place));
            }
            true
        });
        best.1
    }
}

/// Directions of a curve at places all along, each over a longer stretch.
///
/// A fitted curve wavers with the noise of its points, and so do its normals. Against a straight string's wavering a
/// view could slide until the noise fits best, and the normal equations would count that as information. The
/// direction over a longer stretch hardly wavers, and in a bend it is the tangent.
fn directions(curve: &Spline) -> Vec<Point> {
    let pieces = curve.pieces();
    let place = |u: f64| pieces.at(u.clamp(0.0, curve.end())).position;
    (0..=(curve.end() * DIRECTIONS) as usize)
        .map(|i| i as f64 / DIRECTIONS)
        .map(|u| normalized(sub(place(u + STRETCH), place(u - STRETCH))))
        .collect()
}

/// Tukey's biweight.
#[inline]
fn tukey(residual: f64, band: f64) -> f64 {
    let x = residual / band;
    if x.abs() < 1.0 { (1.0 - x * x).powi(2) } else { 0.0 }
}
