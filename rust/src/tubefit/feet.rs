//! Where points belong: the curve and the place on it that explain each best, and how far from its surface it is.
//!
//! Points are sorted by view and by the span that they are on, so that eight of them at a time share one cubic. What is
//! worked out in single precision is relative to the span and in radii: its rounding is far below any noise.

use std::ops::Range;

use rayon::prelude::*;

use super::search::{Search, places};
use super::sums::{Features, SpanSums};
use super::{Foot, OnCurve, Residual, State, TubeFitOptions};
use crate::Point;
use crate::geometry::{normalized, sub};
use crate::simd::{Eight, LANES, Lanes, Simd, Three, kernel};
use crate::spline::{Pieces, Spline};

/// Points searched for, and points on one span that are worked on, by one task; fixed, so that results do not depend on
/// the number of threads.
const POINTS_PER_TASK: usize = 512;
/// Runs of points that one task works on.
const RUNS_PER_TASK: usize = 8;
/// How far to both sides a curve's direction is taken where poses are concerned, in spans.
const STRETCH: f64 = 2.0;
/// At how many places of a span it is taken.
const DIRECTIONS: usize = 8;

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

/// Points of one view on one span.
#[derive(Clone)]
struct Run {
    /// Number of the span, counted through all curves.
    span: usize,
    /// Which of the view's sorted points.
    points: Range<usize>,
}

/// A place on one of the spans, counted through all curves.
#[derive(Clone, Copy, Default)]
struct OnSpan {
    span: u32,
    /// The parameter within the span.
    t: f32,
}

/// A [`Foot`] on a known span, in radii.
#[derive(Clone, Copy, Default)]
pub(super) struct Near {
    /// The parameter within the span.
    t: f32,
    pub(super) residual: f32,
    pub(super) facing: f32,
    weight: f32,
    outward: [f32; 3],
    explained: bool,
    pub(super) inlier: bool,
}

/// Where the points of one view belong.
pub(super) struct ViewTerms {
    /// Numbers of the points that some tube is near to, sorted by span.
    order: Vec<u32>,
    runs: Vec<Run>,
    /// In that order.
    pub(super) near: Vec<Near>,
    /// The curve of each run.
    curves: Vec<usize>,
    /// Their part in the normal equations.
    pub(super) sums: Vec<SpanSums>,
}

/// All curves, span by span.
struct Spans {
    /// Number of each curve's first span, and of all spans.
    first: Vec<usize>,
    spans: Vec<Span>,
}

/// A cubic c₁ t + c₂ t² + c₃ t³ about an origin, in radii.
struct Span {
    curve: usize,
    /// Number of the span in its curve, and how many spans there are.
    number: usize,
    count: usize,
    origin: Point,
    radius: f64,
    cubic: [[f32; 3]; 3],
    /// The curve's direction over a longer stretch, at places from 0 to 1.
    directions: [[f32; 3]; DIRECTIONS + 1],
    /// The extraction range less a margin for noise, about the origin.
    bounds: [[f32; 3]; 2],
    band: f32,
}

/// What the work on a view's points needs to know of it.
struct Eye<'a> {
    points: &'a [Point],
    rotation: [Point; 3],
    translation: Point,
    camera: Point,
    center: Point,
    residual: Residual,
}

impl State<'_> {
    /// The feet of all points at the current curves, poses and radius; on the curves that they are known to be on, or
    /// at first on those that an earlier fit found, if there was one.
    pub(super) fn terms(
        &self,
        options: &TubeFitOptions,
        bands: &[f64],
        known: Option<Vec<ViewTerms>>,
    ) -> Vec<ViewTerms> {
        let search = (known.is_none() && !self.goes_on()).then(|| Search::new(self, options.residual));
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
            };
            let (order, mut places, mut near) = match (known, &search) {
                (Some(known), _) => {
                    let places = known.places();
                    (known.order, places, known.near)
                }
                (None, Some(search)) => {
                    let (order, places) = by_span(eye.searched(search).iter().flatten(), &spans);
                    (order, places, Vec::new())
                }
                (None, None) => {
                    let (order, places) = by_span(self.views[view].feet, &spans);
                    (order, places, Vec::new())
                }
            };
            let settle = |(run, places): (&Run, &mut [OnSpan])| {
                newton(&spans.spans[run.span], &eye, &order[run.points.clone()], places);
            };
            let runs = runs(&places);
            of_runs(&runs, &mut places).into_par_iter().with_min_len(RUNS_PER_TASK).for_each(settle);
            let (order, places) = sorted(order, places, spans.spans.len());
            let runs = self::runs(&places);
            near.resize(places.len(), Near::default());
            let look = |(run, near): (&Run, &mut [Near])| {
                let span = &spans.spans[run.span];
                let mut sums = SpanSums::new(span.curve, span.number);
                feet(span, &eye, &order[run.points.clone()], &places[run.points.clone()], near, &mut sums);
                sums
            };
            let sums =
                of_runs(&runs, &mut near).into_par_iter().with_min_len(RUNS_PER_TASK).map(look).collect();
            let curves = runs.iter().map(|run| spans.spans[run.span].curve).collect();
            ViewTerms { order, runs, near, curves, sums }
        };
        let known: Vec<Option<ViewTerms>> = match known {
            Some(known) => known.into_iter().map(Some).collect(),
            None => self.views.iter().map(|_| None).collect(),
        };
        known.into_par_iter().enumerate().map(in_view).collect()
    }

    /// Where points ended, in their order.
    pub(super) fn feet(&self, terms: &[ViewTerms]) -> Vec<Vec<Foot>> {
        let firsts = firsts(&self.curves);
        let of_view = |(terms, view): (&ViewTerms, &super::TubeView)| {
            let mut feet = vec![NOWHERE; view.points.len()];
            for (run, &curve) in terms.runs.iter().zip(&terms.curves) {
                let r = self.radius(curve);
                for position in run.points.clone() {
                    let near = &terms.near[position];
                    feet[terms.order[position] as usize] = Foot {
                        curve,
                        parameter: (run.span - firsts[curve]) as f64 + f64::from(near.t),
                        residual: r * f64::from(near.residual),
                        outward: near.outward.map(f64::from),
                        facing: f64::from(near.facing),
                        weight: f64::from(near.weight),
                        explained: near.explained,
                        inlier: near.inlier,
                    };
                }
            }
            feet
        };
        terms.iter().zip(self.views).map(of_view).collect()
    }
}

impl ViewTerms {
    /// Where the points belong that belong somewhere.
    fn places(&self) -> Vec<OnSpan> {
        let on_span = |run: &Run| {
            let span = run.span as u32;
            self.near[run.points.clone()].iter().map(move |near| OnSpan { span, t: near.t })
        };
        self.runs.iter().flat_map(on_span).collect()
    }

    /// The curves, and the feet on them, of the points that belong somewhere.
    pub(super) fn on_curves(&self) -> impl Iterator<Item = (usize, &Near)> {
        self.runs
            .iter()
            .zip(&self.curves)
            .flat_map(|(run, &curve)| self.near[run.points.clone()].iter().map(move |near| (curve, near)))
    }
}

impl Eye<'_> {
    /// For each point, task by task, the place that explains it best.
    fn searched(&self, search: &Search) -> Vec<Vec<Option<OnCurve>>> {
        self.points
            .par_chunks(POINTS_PER_TASK)
            .map(|points| {
                let moved: Vec<Point> = points.iter().map(|&p| self.moved(p)).collect();
                places(search, &moved, self.camera)
            })
            .collect()
    }

    #[inline(always)]
    fn moved(&self, p: Point) -> Point {
        std::array::from_fn(|k| {
            let row = self.rotation[k];
            row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + self.translation[k]
        })
    }

    /// Eight points about a span's origin, in radii; a last block repeats its last point.
    #[inline(always)]
    fn block<S: Simd>(&self, simd: S, span: &Span, numbers: &[u32]) -> Three<S::Eight> {
        let mut points = [[0.0; LANES]; 3];
        for l in 0..LANES {
            let p = self.points[numbers[l.min(numbers.len() - 1)] as usize];
            for k in 0..3 {
                points[k][l] = p[k];
            }
        }
        let scale = 1.0 / span.radius;
        let mut block = [Lanes::all(0.0); 3];
        for k in 0..3 {
            let row = self.rotation[k];
            let shift = self.translation[k] - span.origin[k];
            for l in 0..LANES {
                let moved = row[0] * points[0][l] + row[1] * points[1][l] + row[2] * points[2][l];
                block[k].0[l] = ((moved + shift) * scale) as f32;
            }
        }
        Three::load(simd, &block)
    }
}

/// The points that some tube is near to, sorted by span, and where.
fn by_span<'a>(
    places: impl IntoIterator<Item = &'a Option<OnCurve>>,
    spans: &Spans,
) -> (Vec<u32>, Vec<OnSpan>) {
    let (order, starts) =
        (0u32..).zip(places).filter_map(|(i, place)| place.map(|place| (i, spans.of(place)))).unzip();
    sorted(order, starts, spans.spans.len())
}

/// Sorts points by the span that they are on; those of one span stay in their order.
fn sorted(order: Vec<u32>, places: Vec<OnSpan>, spans: usize) -> (Vec<u32>, Vec<OnSpan>) {
    if places.is_sorted_by_key(|place| place.span) {
        return (order, places);
    }
    let mut next = vec![0usize; spans + 1];
    for place in &places {
        next[place.span as usize + 1] += 1;
    }
    for span in 0..spans {
        next[span + 1] += next[span];
    }
    let mut sorted = (vec![0; order.len()], vec![OnSpan::default(); order.len()]);
    for (number, place) in order.into_iter().zip(places) {
        let position = &mut next[place.span as usize];
        (sorted.0[*position], sorted.1[*position]) = (number, place);
        *position += 1;
    }
    sorted
}

/// Stretches of sorted points on one span, none longer than a task.
fn runs(places: &[OnSpan]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (i, place) in places.iter().enumerate() {
        let span = place.span as usize;
        match runs.last_mut() {
            Some(run) if run.span == span && run.points.len() < POINTS_PER_TASK => run.points.end = i + 1,
            _ => runs.push(Run { span, points: i..i + 1 }),
        }
    }
    runs
}

/// Each run with its part of values of all points.
fn of_runs<'a, T>(runs: &'a [Run], mut values: &'a mut [T]) -> Vec<(&'a Run, &'a mut [T])> {
    let part = |run: &'a Run| (run, values.split_off_mut(..run.points.len()).unwrap_or_default());
    runs.iter().map(part).collect()
}

/// Number of each curve's first span, and of all spans.
fn firsts(curves: &[Spline]) -> Vec<usize> {
    let mut firsts = vec![0];
    for curve in curves {
        firsts.push(firsts[firsts.len() - 1] + curve.end() as usize);
    }
    firsts
}

impl Spans {
    fn new(state: &State, options: &TubeFitOptions, bands: &[f64]) -> Self {
        let mut spans = Vec::new();
        for (curve, spline) in state.curves.iter().enumerate() {
            let pieces = spline.pieces();
            let directions = directions(&pieces);
            let radius = state.radius(curve);
            let count = pieces.end() as usize;
            for number in 0..count {
                let [origin, cubic @ ..] = pieces.span(number);
                let bounds = options.bounds.map_or([[-f32::INFINITY; 3], [f32::INFINITY; 3]], |bounds| {
                    let margin = 2.0 * state.sigma;
                    [0, 1].map(|side| {
                        let inwards = if side == 0 { margin } else { -margin };
                        std::array::from_fn(|k| ((bounds[side][k] + inwards - origin[k]) / radius) as f32)
                    })
                });
                spans.push(Span {
                    curve,
                    number,
                    count,
                    origin,
                    radius,
                    cubic: cubic.map(|c| c.map(|x| (x / radius) as f32)),
                    directions: std::array::from_fn(|i| {
                        directions[number * DIRECTIONS + i].map(|x| x as f32)
                    }),
                    bounds,
                    band: (bands[state.ropes[curve]] / radius) as f32,
                });
            }
        }
        Self { first: firsts(&state.curves), spans }
    }

    /// A place by its span.
    fn of(&self, place: OnCurve) -> OnSpan {
        let first = self.first[place.curve];
        let span = (first + place.parameter as usize).min(self.first[place.curve + 1] - 1);
        OnSpan { span: span as u32, t: (place.parameter - (span - first) as f64) as f32 }
    }
}

impl Span {
    /// Positions and derivatives.
    #[inline(always)]
    fn at<S: Simd>(&self, simd: S, t: S::Eight) -> [Three<S::Eight>; 3] {
        let c1 = Three::all(simd, self.cubic[0]);
        let c2 = Three::all(simd, self.cubic[1]);
        let c3 = Three::all(simd, self.cubic[2]);
        let (two, three, six) = (simd.splat8(2.0), simd.splat8(3.0), simd.splat8(6.0));
        [(c1 + (c2 + c3 * t) * t) * t, c1 + (c2 * two + c3 * (three * t)) * t, c2 * two + c3 * (six * t)]
    }
}

/// Directions of a curve at places all along, each over a longer stretch.
///
/// A fitted curve wavers with the noise of its points, and so do its normals. Against a straight string's wavering a
/// view could slide until the noise fits best, and the normal equations would count that as information. The
/// direction over a longer stretch hardly wavers, and in a bend it is the tangent.
fn directions(pieces: &Pieces) -> Vec<Point> {
    let place = |u: f64| pieces.at(u.clamp(0.0, pieces.end())).position;
    (0..=pieces.end() as usize * DIRECTIONS)
        .map(|i| i as f64 / DIRECTIONS as f64)
        .map(|u| normalized(sub(place(u + STRETCH), place(u - STRETCH))))
        .collect()
}

kernel! {
    /// Moves places on a span to the feet of their points, which may lie on another span of the curve.
    fn newton<S>(simd, span: &Span, eye: &Eye, numbers: &[u32], places: &mut [OnSpan]) {
        let least = simd.splat8(-(span.number as f32));
        let most = simd.splat8((span.count - span.number) as f32);
        for (numbers, places) in numbers.chunks(LANES).zip(places.chunks_mut(LANES)) {
            let p = eye.block(simd, span, numbers);
            let mut starts = Lanes::all(0.0);
            for (start, place) in starts.0.iter_mut().zip(places.iter()) {
                *start = place.t;
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
    /// The feet of points at their places on a span, and their part in the normal equations.
    fn feet<S>(
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
            let p = eye.block(simd, span, numbers);
            let mut parameters = Lanes::all(0.0);
            let mut here = Lanes::all(0.0);
            let mut direction = [Lanes::all(0.0); 3];
            for (l, place) in places.iter().enumerate() {
                parameters.0[l] = place.t;
                here.0[l] = 1.0;
                let along = span.directions[(place.t * DIRECTIONS as f32 + 0.5) as usize];
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
                Residual::Distance => across(simd, q, d, to_camera, band),
                Residual::Ray => along_ray(simd, q, to_camera, tangent, band),
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
                    t: parameters.0[l],
                    residual: residual.0[l],
                    facing: facing.0[l],
                    weight: weight.0[l],
                    outward: [outward[0].0[l], outward[1].0[l], outward[2].0[l]],
                    explained: explained.0[l] > 0.0,
                    inlier: inlier.0[l] > 0.0,
                };
            }
            // the outward normal as far as poses are concerned: at a right angle to the curve's direction over a
            // longer stretch, see `directions`
            let direction = Three::load(simd, &direction);
            let settled = (foot.outward - direction * foot.outward.dot(direction)).unit(simd);
            sums.add(simd, &Features {
                t,
                weight: foot.weight,
                outward: foot.outward,
                turn: (arm + p * radius).cross(settled),
                settled,
                residual: radius * foot.residual,
            });
        }
    }
}

/// Eight feet.
struct Feet<V> {
    residual: V,
    outward: Three<V>,
    facing: V,
    weight: V,
    explained: V,
    inlier: V,
}

/// The distance from the surface, of points at `q` from the axis, `d` away from it.
#[inline(always)]
fn across<S: Simd>(
    simd: S,
    q: Three<S::Eight>,
    d: S::Eight,
    to_camera: Three<S::Eight>,
    band: S::Eight,
) -> Feet<S::Eight> {
    let one = simd.splat8(1.0);
    let outward = q * (one / d);
    let facing = outward.dot(to_camera);
    let residual = d - one;
    let explained = simd.splat8(0.1).below(facing);
    Feet {
        residual,
        outward,
        facing,
        weight: explained * tukey(simd, residual, band),
        explained,
        inlier: explained * residual.abs().below(band),
    }
}

/// The residual along the viewing ray, with the tube's straight cylinder at the foot.
#[inline(always)]
fn along_ray<S: Simd>(
    simd: S,
    q: Three<S::Eight>,
    to_camera: Three<S::Eight>,
    tangent: Three<S::Eight>,
    band: S::Eight,
) -> Feet<S::Eight> {
    let (zero, one) = (simd.splat8(0.0), simd.splat8(1.0));
    // across the axis: the ray is q + λ w, nearest to the axis at λ₀
    let w = to_camera - tangent * to_camera.dot(tangent);
    let square = w.dot(w) + simd.splat8(1e-12);
    let nearest = zero - q.dot(w) / square;
    let miss = q + w * nearest;
    let gap = miss.dot(miss);
    let hit = gap.below(one);
    let missed_by = gap.sqrt() - one;
    let length = nearest + ((one - gap).max(zero) / square).sqrt();
    let outward = (q + w * length).unit(simd) * hit;
    let facing = outward.dot(to_camera);
    let residual = hit.choose(zero - length * facing, missed_by);
    let cosine = facing.max(simd.splat8(0.4));
    let near = length.abs().below(simd.splat8(1.2));
    let weight = tukey(simd, residual, band * cosine.max(simd.splat8(0.5))) / (cosine * cosine);
    let explained = hit.max(missed_by.below(simd.splat8(0.25)));
    Feet {
        residual,
        outward,
        facing,
        weight: weight * near * hit,
        explained,
        inlier: explained * residual.abs().below(band),
    }
}

/// Tukey's biweight.
#[inline(always)]
fn tukey<S: Simd>(simd: S, residual: S::Eight, band: S::Eight) -> S::Eight {
    let x = residual / band;
    let share = (simd.splat8(1.0) - x * x).max(simd.splat8(0.0));
    share * share
}
