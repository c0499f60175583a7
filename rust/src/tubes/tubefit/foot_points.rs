//! Foot points: the place on the curves that explains each point best, and the point's distance from the surface.
//!
//! Points are sorted by view and by span, so that eight points at a time share one cubic. Single-precision numbers are
//! relative to the span and in radii: their rounding is far below any noise.

use rayon::prelude::*;

use crate::parallel::go_on;

use super::input::{OnCurve, Residual, TubeFitOptions, TubeView};
use super::outcome::FootPoint;
use super::residuals::{measure_along_rays, measure_distances};
use super::search::{Search, find_places};
use super::spans::{
    DIRECTIONS, OnSpan, POINTS_PER_TASK, Run, Span, Spans, find_runs, number_spans, resort, sort_by_span,
    split_by_run,
};
use super::state::State;
use super::sums::{Features, SpanSums, Wanted};
use crate::geometry::Point;
use crate::simd::{Eight, LANES, Lanes, Simd, Three, kernel};

const RUNS_PER_TASK: usize = 8; // runs of points that one task works on

/// The foot point of a point without a tube nearby.
const NOWHERE: FootPoint = FootPoint {
    curve: 0,
    parameter: 0.0,
    residual: f64::INFINITY,
    outward: [0.0; 3],
    facing: 0.0,
    weight: 0.0,
    explained: false,
    inlier: false,
};

/// A [`FootPoint`] on a known span, in radii.
#[derive(Clone, Copy, Default)]
pub(super) struct Near {
    pub(super) residual: f32,
    pub(super) facing: f32,
    weight: f32,
    outward: [f32; 3],
    explained: bool,
    pub(super) inlier: bool,
}

/// The foot points of one view.
#[derive(Clone)]
pub(super) struct ViewTerms {
    /// Numbers of the points that have a tube nearby, sorted by span.
    order: Vec<u32>,
    runs: Vec<Run>,
    /// Places and foot points in that order.
    places: Vec<OnSpan>,
    pub(super) near: Vec<Near>,
    /// The curve of each run.
    curves: Vec<usize>,
    /// The runs' sums for the normal equations, as far as they were wanted.
    pub(super) sums: Vec<SpanSums>,
}

/// A view, as the kernels need it.
struct Eye<'a> {
    points: &'a [Point],
    rotation: [Point; 3],
    translation: Point,
    camera: Point,
    center: Point,
    residual: Residual,
    /// Square roots of the shares with which points count: along their rays, and across them.
    counts: Option<[f32; 2]>,
    wanted: Wanted,
}

impl State<'_> {
    /// Finds the foot points of all points at the current curves, poses and radii; on their `known` curves, if given.
    pub(super) fn terms(
        &self,
        options: &TubeFitOptions,
        bands: &[f64],
        known: Option<Vec<ViewTerms>>,
        wanted: Wanted,
    ) -> Vec<ViewTerms> {
        self.terms_counted(options, bands, known, wanted, None)
    }

    /// As [`State::terms`], with points that count for less than one in the sums.
    pub(super) fn terms_counted(
        &self,
        options: &TubeFitOptions,
        bands: &[f64],
        known: Option<Vec<ViewTerms>>,
        wanted: Wanted,
        counts: Option<[f32; 2]>,
    ) -> Vec<ViewTerms> {
        let search = known.is_none().then(|| Search::new(self, options.residual));
        let spans = Spans::new(self, options, bands);
        let in_view = |(view, known): (usize, Option<ViewTerms>)| {
            let motion = &self.motions[view];
            let eye = Eye {
                points: self.views[view].points,
                rotation: std::array::from_fn(|i| std::array::from_fn(|j| motion.rotation[(i, j)])),
                translation: motion.translation.into(),
                camera: motion.apply(self.views[view].viewpoint),
                center: self.center,
                residual: options.residual,
                counts,
                wanted,
            };
            let (order, mut places, runs, mut near) = match (&search, known) {
                (None, Some(known)) => (known.order, known.places, known.runs, known.near),
                (Some(search), _) => {
                    let (order, places) = sort_by_span(eye.searched(search).iter().flatten(), &spans.first);
                    let runs = find_runs(&places);
                    (order, places, runs, Vec::new())
                }
                (None, None) => Default::default(),
            };
            let settle = |(run, places): (&Run, &mut [OnSpan])| {
                go_on();
                move_to_foot_points(&spans.spans[run.span], &eye, &order[run.points.clone()], places);
            };
            split_by_run(&runs, &mut places).into_par_iter().with_min_len(RUNS_PER_TASK).for_each(settle);
            let (order, places) = resort(order, places, spans.spans.len());
            let runs = find_runs(&places);
            near.resize(places.len(), Near::default());
            let empty = |run: &Run| SpanSums::new(spans.spans[run.span].curve, spans.spans[run.span].number);
            let mut sums: Vec<SpanSums> = runs.iter().map(empty).collect();
            let of_run = |((run, near), sums): ((&Run, &mut [Near]), &mut SpanSums)| {
                go_on();
                let (order, places) = (&order[run.points.clone()], &places[run.points.clone()]);
                evaluate(&spans.spans[run.span], &eye, order, places, near, sums);
            };
            split_by_run(&runs, &mut near)
                .into_par_iter()
                .zip(&mut sums)
                .with_min_len(RUNS_PER_TASK)
                .for_each(of_run);
            let curves = runs.iter().map(|run| spans.spans[run.span].curve).collect();
            ViewTerms { order, runs, places, near, curves, sums }
        };
        let known: Vec<Option<ViewTerms>> = match known {
            Some(known) => known.into_iter().map(Some).collect(),
            None => self.views.iter().map(|_| None).collect(),
        };
        known.into_par_iter().enumerate().map(in_view).collect()
    }

    /// Takes the foot points of an earlier fit, without residuals.
    pub(super) fn begun(&self) -> Vec<ViewTerms> {
        let firsts = number_spans(&self.curves);
        let of_view = |view: &TubeView| {
            let (order, places) = sort_by_span(view.foot_points, &firsts);
            let (runs, near) = (find_runs(&places), Vec::new());
            ViewTerms { order, runs, places, near, curves: Vec::new(), sums: Vec::new() }
        };
        self.views.iter().map(of_view).collect()
    }

    /// Returns the foot points in the order of the points.
    pub(super) fn foot_points(&self, terms: &[ViewTerms]) -> Vec<Vec<FootPoint>> {
        let firsts = number_spans(&self.curves);
        let of_view = |(terms, view): (&ViewTerms, &TubeView)| {
            let mut foot_points = vec![NOWHERE; view.points.len()];
            for (run, &curve) in terms.runs.iter().zip(&terms.curves) {
                let r = self.radius(curve);
                for position in run.points.clone() {
                    let near = &terms.near[position];
                    foot_points[terms.order[position] as usize] = FootPoint {
                        curve,
                        parameter: (run.span - firsts[curve]) as f64 + f64::from(terms.places[position].t),
                        residual: r * f64::from(near.residual),
                        outward: near.outward.map(f64::from),
                        facing: f64::from(near.facing),
                        weight: f64::from(near.weight),
                        explained: near.explained,
                        inlier: near.inlier,
                    };
                }
            }
            foot_points
        };
        terms.iter().zip(self.views).map(of_view).collect()
    }
}

impl ViewTerms {
    /// Iterates over the foot points on each span, and their curves.
    pub(super) fn on_curves(&self) -> impl Iterator<Item = (usize, &[Near])> {
        self.curves.iter().zip(&self.runs).map(|(&curve, run)| (curve, &self.near[run.points.clone()]))
    }
}

impl Eye<'_> {
    /// Finds for each point, task by task, the place that explains it best.
    fn searched(&self, search: &Search) -> Vec<Vec<Option<OnCurve>>> {
        self.points
            .par_chunks(POINTS_PER_TASK)
            .map(|points| {
                go_on();
                let moved: Vec<Point> = points.iter().map(|&p| self.moved(p)).collect();
                find_places(search, &moved, self.camera)
            })
            .collect()
    }

    #[inline(always)]
    fn moved(&self, p: Point) -> Point {
        let mut moved = self.translation;
        for k in 0..3 {
            let row = self.rotation[k];
            moved[k] = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + self.translation[k];
        }
        moved
    }

    /// Moves eight points and returns them relative to a span's origin, in radii.
    #[inline(always)]
    fn block<S: Simd>(&self, simd: S, span: &Span, numbers: [u32; LANES]) -> Three<S::Eight> {
        let mut points = [[0.0; LANES]; 3];
        for l in 0..LANES {
            let p = self.points[numbers[l] as usize];
            for k in 0..3 {
                points[k][l] = p[k];
            }
        }
        let (x, y, z) = (simd.load_half(&points[0]), simd.load_half(&points[1]), simd.load_half(&points[2]));
        let scale = simd.splat_half(1.0 / span.radius);
        // operations on whole registers: the compiler would make scattered stores of loops over the lanes
        let mut block = [simd.splat8(0.0); 3];
        for k in 0..3 {
            let row = self.rotation[k];
            let moved = simd.mul_half(simd.splat_half(row[0]), x);
            let moved = simd.add_half(moved, simd.mul_half(simd.splat_half(row[1]), y));
            let moved = simd.add_half(moved, simd.mul_half(simd.splat_half(row[2]), z));
            let moved = simd.add_half(moved, simd.splat_half(self.translation[k] - span.origin[k]));
            block[k] = simd.narrow_half(simd.mul_half(moved, scale));
        }
        Three(block)
    }
}

impl Span {
    /// Returns positions and derivatives.
    #[inline(always)]
    fn at<S: Simd>(&self, simd: S, t: S::Eight) -> [Three<S::Eight>; 3] {
        let c1 = Three::all(simd, self.cubic[0]);
        let c2 = Three::all(simd, self.cubic[1]);
        let c3 = Three::all(simd, self.cubic[2]);
        let (two, three, six) = (simd.splat8(2.0), simd.splat8(3.0), simd.splat8(6.0));
        [(c1 + (c2 + c3 * t) * t) * t, c1 + (c2 * two + c3 * (three * t)) * t, c2 * two + c3 * (six * t)]
    }
}

/// Returns the first eight values; fewer are filled up with the last.
#[inline(always)]
fn take_eight<T: Copy>(values: &[T]) -> [T; LANES] {
    if let Some(eight) = values.first_chunk() {
        return *eight;
    }
    let mut eight = [values[values.len() - 1]; LANES];
    for (to, &value) in eight.iter_mut().zip(values) {
        *to = value;
    }
    eight
}

kernel! {
    /// Moves places on a span to the foot points of their points, which may lie on another span of the curve.
    fn move_to_foot_points<S>(simd, span: &Span, eye: &Eye, numbers: &[u32], places: &mut [OnSpan]) {
        let least = simd.splat8(-(span.number as f32));
        let most = simd.splat8((span.count - span.number) as f32);
        for (numbers, places) in numbers.chunks(LANES).zip(places.chunks_mut(LANES)) {
            let p = eye.block(simd, span, take_eight(numbers));
            let mut starts = Lanes::all(0.0);
            let first = take_eight(places);
            for l in 0..LANES {
                starts.0[l] = first[l].t;
            }
            let mut t = simd.load8(&starts);
            for _ in 0..2 {
                let [position, first, second] = span.at(simd, t);
                let x = p - position;
                let square = first.dot(first);
                let slope = (square - x.dot(second)).max(simd.splat8(0.3) * square);
                t = (t + x.dot(first) / slope).max(least).min(most);
            }
            let steps = t.floor().min(most - simd.splat8(1.0));
            let (rest, steps) = ((t - steps).store(), steps.store());
            for (l, place) in places.iter_mut().enumerate() {
                place.span = place.span.wrapping_add_signed(steps.0[l] as i32);
                place.t = rest.0[l];
            }
        }
    }
}

kernel! {
    /// Evaluates foot points at their places on a span, and adds them to the normal equations.
    fn evaluate<S>(
        simd,
        span: &Span,
        eye: &Eye,
        numbers: &[u32],
        places: &[OnSpan],
        near: &mut [Near],
        sums: &mut SpanSums
    ) {
        let one = simd.splat8(1.0);
        let camera = Three::all(simd, [
            ((eye.camera[0] - span.origin[0]) / span.radius) as f32,
            ((eye.camera[1] - span.origin[1]) / span.radius) as f32,
            ((eye.camera[2] - span.origin[2]) / span.radius) as f32,
        ]);
        let arm = Three::all(simd, [
            (span.origin[0] - eye.center[0]) as f32,
            (span.origin[1] - eye.center[1]) as f32,
            (span.origin[2] - eye.center[2]) as f32,
        ]);
        let (radius, band) = (simd.splat8(span.radius as f32), simd.splat8(span.band));
        let (low, high) = (Three::all(simd, span.bounds[0]), Three::all(simd, span.bounds[1]));
        let blocks = numbers.chunks(LANES).zip(places.chunks(LANES)).zip(near.chunks_mut(LANES));
        for ((numbers, places), near) in blocks {
            let p = eye.block(simd, span, take_eight(numbers));
            let count = places.len();
            let places = take_eight(places);
            let mut parameters = Lanes::all(0.0);
            let mut here = Lanes::all(0.0);
            let mut direction = [Lanes::all(0.0); 3];
            for l in 0..LANES {
                let t = places[l].t;
                parameters.0[l] = t;
                here.0[l] = if l < count { 1.0 } else { 0.0 };
                let along = span.directions[(t * DIRECTIONS as f32 + 0.5) as usize];
                for k in 0..3 {
                    direction[k].0[l] = along[k];
                }
            }
            let t = simd.load8(&parameters);
            let [axis, first, _] = span.at(simd, t);
            let tangent = first.unit(simd);
            let to_camera = (camera - p).unit(simd);
            let x = p - axis;
            let beyond = x.dot(tangent);
            let q = x - tangent * beyond;
            let d = q.dot(q).sqrt().max(simd.splat8(f32::MIN_POSITIVE));
            let mut foot = match eye.residual {
                Residual::Distance => measure_distances(simd, q, d, to_camera, band),
                Residual::Ray => measure_along_rays(simd, q, to_camera, tangent, band),
            };
            // beyond the end of a curve there is no surface
            let on = beyond.abs().not_above(simd.splat8(0.02));
            foot.residual = on.choose(foot.residual, d - one);
            foot.outward = foot.outward * on;
            let surface = axis + foot.outward;
            let mut part = on * simd.load8(&here);
            for k in 0..3 {
                part = part * low.0[k].not_above(surface.0[k]) * surface.0[k].not_above(high.0[k]);
            }
            foot.weight = foot.weight * part;
            let (residual, facing) = (foot.residual.store(), (foot.facing * on).store());
            let (weight, explained) = (foot.weight.store(), (foot.explained * on).store());
            let (inlier, [x, y, z]) = ((foot.inlier * on).store(), foot.outward.0);
            let outward = [x.store(), y.store(), z.store()];
            for (l, near) in near.iter_mut().enumerate() {
                *near = Near {
                    residual: residual.0[l],
                    facing: facing.0[l],
                    weight: weight.0[l],
                    outward: [outward[0].0[l], outward[1].0[l], outward[2].0[l]],
                    explained: explained.0[l] > 0.0,
                    inlier: inlier.0[l] > 0.0,
                };
            }
            if eye.wanted == Wanted::Nothing {
                continue;
            }
            // the normal as poses see it: perpendicular to the curve's direction over a longer stretch, see
            // `find_directions`
            let direction = Three::load(simd, &direction);
            let settled = (foot.outward - direction * foot.outward.dot(direction)).unit(simd);
            let (outward, settled, grown) = match eye.counts {
                None => (foot.outward, settled, simd.splat8(-1.0)),
                Some([along, across]) => {
                    // only the ray's part across the curve counts: nothing moves a curve along itself
                    let ray = (to_camera - tangent * to_camera.dot(tangent)).unit(simd);
                    let counted = |normal: Three<S::Eight>| {
                        let part = ray * normal.dot(ray);
                        part * simd.splat8(along) + (normal - part) * simd.splat8(across)
                    };
                    (counted(foot.outward), counted(settled), simd.splat8(-along))
                }
            };
            let features = Features {
                t,
                weight: foot.weight,
                outward,
                turn: (arm + p * radius).cross(settled),
                settled,
                grown,
                residual: radius * foot.residual,
            };
            sums.add(simd, &features, eye.wanted == Wanted::All);
        }
    }
}
