//! Where points belong: the curve and the place on it that explain each best, and how far from its surface it is.
//!
//! Points are sorted by view and by the span that they are on, so that eight of them at a time share one cubic. What is
//! worked out in single precision is relative to the span and in radii: its rounding is far below any noise.

use std::ops::Range;

use rayon::prelude::*;

use super::search::Search;
use super::sums::{Features, SpanSums};
use super::{Foot, OnCurve, Residual, State, TubeFitOptions};
use crate::Point;
use crate::geometry::{normalized, sub};
use crate::lanes::{self, LANES, Lanes, wide};
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
    /// The feet of all points at the current curves, poses and radius; on the curves that they are known to be on.
    pub(super) fn terms(
        &self,
        options: &TubeFitOptions,
        bands: &[f64],
        known: Option<&[ViewTerms]>,
    ) -> Vec<ViewTerms> {
        let search = known.is_none().then(|| Search::new(self, options.residual));
        let spans = Spans::new(self, options, bands);
        let in_view = |view: usize| {
            let motion = &self.motions[view];
            let eye = Eye {
                points: self.views[view].points,
                rotation: std::array::from_fn(|i| std::array::from_fn(|j| motion.rotation[(i, j)])),
                translation: motion.translation.into(),
                camera: motion.apply(self.views[view].viewpoint),
                center: self.center,
                residual: options.residual,
            };
            let (order, mut starts) = match (&search, known) {
                (None, Some(known)) => known[view].places(),
                (Some(search), _) => eye.searched(search, &spans),
                (None, None) => (Vec::new(), Vec::new()),
            };
            let runs = runs(&starts);
            let settle = |runs: &[Run]| {
                let range = whole(runs);
                let mut t: Vec<f32> = starts[range.clone()].iter().map(|start| start.1).collect();
                for Run { span, points } in runs {
                    let t = &mut t[points.start - range.start..points.end - range.start];
                    newton(&spans.spans[*span], &eye, &order[points.clone()], t);
                }
                t
            };
            let settled: Vec<Vec<f32>> = runs.par_chunks(RUNS_PER_TASK).map(settle).collect();
            let from = runs.iter().flat_map(|run| run.points.clone().map(|_| run.span));
            for ((start, t), span) in starts.iter_mut().zip(settled.into_iter().flatten()).zip(from) {
                *start = spans.spans[span].moved(span, t);
            }
            let (order, starts) = sorted(order, starts, spans.spans.len());
            let runs = self::runs(&starts);
            let look = |runs: &[Run]| {
                let range = whole(runs);
                let mut near: Vec<Near> = starts[range.clone()]
                    .iter()
                    .map(|start| Near { t: start.1, ..Near::default() })
                    .collect();
                let mut sums = Vec::with_capacity(runs.len());
                for Run { span, points } in runs {
                    let span = &spans.spans[*span];
                    let near = &mut near[points.start - range.start..points.end - range.start];
                    let mut of_run = SpanSums::new(span.curve, span.number);
                    feet(span, &eye, &order[points.clone()], near, &mut of_run);
                    sums.push(of_run);
                }
                (near, sums)
            };
            let (near, sums): (Vec<Vec<Near>>, Vec<Vec<SpanSums>>) =
                runs.par_chunks(RUNS_PER_TASK).map(look).unzip();
            let curves = runs.iter().map(|run| spans.spans[run.span].curve).collect();
            ViewTerms { order, runs, near: near.concat(), curves, sums: sums.into_iter().flatten().collect() }
        };
        (0..self.views.len()).into_par_iter().map(in_view).collect()
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
    /// The points that belong somewhere, and the span and the parameter in it of each.
    fn places(&self) -> (Vec<u32>, Vec<(usize, f32)>) {
        let starts = self
            .runs
            .iter()
            .flat_map(|run| self.near[run.points.clone()].iter().map(|near| (run.span, near.t)));
        (self.order.clone(), starts.collect())
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
    /// The points that some tube is near to, sorted by span, and the span and the parameter in it of each.
    fn searched(&self, search: &Search, spans: &Spans) -> (Vec<u32>, Vec<(usize, f32)>) {
        let places: Vec<Vec<Option<OnCurve>>> = self
            .points
            .par_chunks(POINTS_PER_TASK)
            .map(|points| {
                let moved: Vec<Point> = points.iter().map(|&p| self.moved(p)).collect();
                search.places(&moved, self.camera)
            })
            .collect();
        let (order, starts) = (0u32..)
            .zip(places.iter().flatten())
            .filter_map(|(i, place)| place.map(|place| (i, spans.of(place))))
            .unzip();
        sorted(order, starts, spans.spans.len())
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
    fn block(&self, span: &Span, numbers: &[u32]) -> [Lanes; 3] {
        let mut block = [Lanes::all(0.0); 3];
        let scale = 1.0 / span.radius;
        for l in 0..LANES {
            let p = self.moved(self.points[numbers[l.min(numbers.len() - 1)] as usize]);
            for k in 0..3 {
                block[k].0[l] = ((p[k] - span.origin[k]) * scale) as f32;
            }
        }
        block
    }
}

/// Sorts points by the span that they are on; those of one span stay in their order.
fn sorted(order: Vec<u32>, starts: Vec<(usize, f32)>, spans: usize) -> (Vec<u32>, Vec<(usize, f32)>) {
    if starts.is_sorted_by_key(|start| start.0) {
        return (order, starts);
    }
    let mut next = vec![0usize; spans + 1];
    for start in &starts {
        next[start.0 + 1] += 1;
    }
    for span in 0..spans {
        next[span + 1] += next[span];
    }
    let (mut numbers, mut places) = (vec![0; order.len()], vec![(0, 0.0); order.len()]);
    for (number, start) in order.into_iter().zip(starts) {
        let position = &mut next[start.0];
        (numbers[*position], places[*position]) = (number, start);
        *position += 1;
    }
    (numbers, places)
}

/// Stretches of sorted points on one span, none longer than a task.
fn runs(starts: &[(usize, f32)]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (i, start) in starts.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if run.span == start.0 && run.points.len() < POINTS_PER_TASK => run.points.end = i + 1,
            _ => runs.push(Run { span: start.0, points: i..i + 1 }),
        }
    }
    runs
}

/// All points of some runs, which follow on each other.
fn whole(runs: &[Run]) -> Range<usize> {
    runs[0].points.start..runs[runs.len() - 1].points.end
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

    /// The span of a place, and the parameter within it.
    fn of(&self, place: OnCurve) -> (usize, f32) {
        let first = self.first[place.curve];
        let span = (first + place.parameter as usize).min(self.first[place.curve + 1] - 1);
        (span, (place.parameter - (span - first) as f64) as f32)
    }
}

impl Span {
    /// The span, whose number among all is given, or its neighbour that a parameter counted from it lies in, and the
    /// parameter within that one.
    #[inline]
    fn moved(&self, span: usize, t: f32) -> (usize, f32) {
        let target = (self.number as f32 + t.floor()).clamp(0.0, (self.count - 1) as f32) as usize;
        let steps = target as f32 - self.number as f32;
        (span + target - self.number, t - steps)
    }

    #[inline(always)]
    fn at(&self, t: Lanes) -> [[Lanes; 3]; 3] {
        let [c1, c2, c3] = self.cubic.map(|c| c.map(Lanes::all));
        let [two, three, six] = [2.0, 3.0, 6.0].map(Lanes::all);
        [
            std::array::from_fn(|k| t * (c1[k] + t * (c2[k] + t * c3[k]))),
            std::array::from_fn(|k| c1[k] + t * (two * c2[k] + t * (three * c3[k]))),
            std::array::from_fn(|k| two * c2[k] + six * t * c3[k]),
        ]
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

wide! {
    /// Moves parameters, counted from a span, to the feet of its points.
    fn newton(span: &Span, eye: &Eye, numbers: &[u32], t: &mut [f32]) {
        let low = Lanes::all(-(span.number as f32));
        let high = Lanes::all((span.count - span.number) as f32);
        for (numbers, t) in numbers.chunks(LANES).zip(t.chunks_mut(LANES)) {
            let p = eye.block(span, numbers);
            let mut u = Lanes::all(0.0);
            u.0[..t.len()].copy_from_slice(t);
            for _ in 0..2 {
                let [position, first, second] = span.at(u);
                let x: [Lanes; 3] = std::array::from_fn(|k| p[k] - position[k]);
                let square = lanes::dot(first, first);
                let slope = (square - lanes::dot(x, second)).max(Lanes::all(0.3) * square);
                u = (u + lanes::dot(x, first) / slope).max(low).min(high);
            }
            t.copy_from_slice(&u.0[..t.len()]);
        }
    }
}

wide! {
    /// The feet of points on a span, whose parameters are known, and their part in the normal equations.
    fn feet(span: &Span, eye: &Eye, numbers: &[u32], near: &mut [Near], sums: &mut SpanSums) {
        let [zero, one] = [0.0, 1.0].map(Lanes::all);
        let camera: [Lanes; 3] =
            std::array::from_fn(|k| Lanes::all(((eye.camera[k] - span.origin[k]) / span.radius) as f32));
        let arm: [Lanes; 3] = std::array::from_fn(|k| Lanes::all((span.origin[k] - eye.center[k]) as f32));
        let radius = Lanes::all(span.radius as f32);
        let [low, high] = span.bounds.map(|corner| corner.map(Lanes::all));
        for (numbers, near) in numbers.chunks(LANES).zip(near.chunks_mut(LANES)) {
            let p = eye.block(span, numbers);
            let mut t = zero;
            let mut here = zero;
            let mut direction = [zero; 3];
            for (l, near) in near.iter().enumerate() {
                t.0[l] = near.t;
                here.0[l] = 1.0;
                let along = span.directions[(near.t * DIRECTIONS as f32).round() as usize];
                for k in 0..3 {
                    direction[k].0[l] = along[k];
                }
            }
            let [axis, first, _] = span.at(t);
            let tangent = unit(first);
            let to_camera = unit(std::array::from_fn(|k| camera[k] - p[k]));
            let x: [Lanes; 3] = std::array::from_fn(|k| p[k] - axis[k]);
            let beyond = lanes::dot(x, tangent);
            let q: [Lanes; 3] = std::array::from_fn(|k| x[k] - beyond * tangent[k]);
            let d = lanes::dot(q, q).sqrt().max(Lanes::all(f32::MIN_POSITIVE));
            let on = Lanes::all(0.02).below(beyond.abs());
            let on = one - on;
            let band = Lanes::all(span.band);
            let mut foot = match eye.residual {
                Residual::Distance => {
                    let outward = q.map(|x| x / d);
                    let facing = lanes::dot(outward, to_camera);
                    let residual = d - one;
                    let explained = Lanes::all(0.1).below(facing);
                    let weight = explained * tukey(residual, band);
                    let inlier = explained * residual.abs().below(band);
                    LanesFoot { residual, outward, facing, weight, explained, inlier }
                }
                Residual::Ray => along_ray(q, to_camera, tangent, band),
            };
            foot.residual = on.choose(foot.residual, d - one);
            foot.outward = foot.outward.map(|x| x * on);
            foot.facing = foot.facing * on;
            let surface: [Lanes; 3] = std::array::from_fn(|k| axis[k] + foot.outward[k]);
            let cut = (0..3).fold(zero, |cut, k| {
                cut.max(surface[k].below(low[k])).max(high[k].below(surface[k]))
            });
            foot.weight = foot.weight * on * here * (one - cut);
            foot.explained = foot.explained * on;
            foot.inlier = foot.inlier * on;
            for (l, near) in near.iter_mut().enumerate() {
                near.residual = foot.residual.0[l];
                near.facing = foot.facing.0[l];
                near.weight = foot.weight.0[l];
                near.outward = foot.outward.map(|x| x.0[l]);
                near.explained = foot.explained.0[l] > 0.0;
                near.inlier = foot.inlier.0[l] > 0.0;
            }
            // the outward normal as far as poses are concerned: at a right angle to the curve's direction over a
            // longer stretch, see `directions`
            let aside = lanes::dot(foot.outward, direction);
            let settled = unit(std::array::from_fn(|k| foot.outward[k] - aside * direction[k]));
            let arm: [Lanes; 3] = std::array::from_fn(|k| arm[k] + radius * p[k]);
            sums.add(&Features {
                t,
                weight: foot.weight,
                outward: foot.outward,
                turn: lanes::cross(arm, settled),
                settled,
                residual: radius * foot.residual,
            });
        }
    }
}

/// Eight feet.
struct LanesFoot {
    residual: Lanes,
    outward: [Lanes; 3],
    facing: Lanes,
    weight: Lanes,
    explained: Lanes,
    inlier: Lanes,
}

/// The residual along the viewing ray, with the tube's straight cylinder at the foot.
#[inline(always)]
fn along_ray(q: [Lanes; 3], to_camera: [Lanes; 3], tangent: [Lanes; 3], band: Lanes) -> LanesFoot {
    let [zero, one] = [0.0, 1.0].map(Lanes::all);
    // across the axis: the ray is q + λ w, nearest to the axis at λ₀
    let along = lanes::dot(to_camera, tangent);
    let w: [Lanes; 3] = std::array::from_fn(|k| to_camera[k] - along * tangent[k]);
    let square = lanes::dot(w, w) + Lanes::all(1e-12);
    let nearest = zero - lanes::dot(q, w) / square;
    let miss: [Lanes; 3] = std::array::from_fn(|k| q[k] + nearest * w[k]);
    let gap = lanes::dot(miss, miss);
    let hit = gap.below(one);
    let missed_by = gap.sqrt() - one;
    let length = nearest + ((one - gap).max(zero) / square).sqrt();
    let outward = unit(std::array::from_fn(|k| q[k] + length * w[k]));
    let facing = lanes::dot(outward, to_camera);
    let residual = hit.choose(zero - length * facing, missed_by);
    let cosine = facing.max(Lanes::all(0.4));
    let near = length.abs().below(Lanes::all(1.2));
    let weight = tukey(residual, band * cosine.max(Lanes::all(0.5))) / (cosine * cosine);
    let explained = hit.max(missed_by.below(Lanes::all(0.25)));
    LanesFoot {
        residual,
        outward: outward.map(|x| x * hit),
        facing: facing * hit,
        weight: weight * near * hit,
        explained,
        inlier: explained * residual.abs().below(band),
    }
}

#[inline(always)]
fn unit(a: [Lanes; 3]) -> [Lanes; 3] {
    let scale = lanes::dot(a, a).sqrt().max(Lanes::all(f32::MIN_POSITIVE)).recip();
    a.map(|x| x * scale)
}

/// Tukey's biweight.
#[inline(always)]
fn tukey(residual: Lanes, band: Lanes) -> Lanes {
    let x = residual / band;
    let share = (Lanes::all(1.0) - x * x).max(Lanes::all(0.0));
    share * share
}
