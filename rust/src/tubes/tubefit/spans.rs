//! The spans of the curves, and points sorted by span.

use std::ops::Range;

use super::input::{OnCurve, TubeFitOptions};
use super::state::State;
use crate::geometry::spline::{Pieces, Spline};
use crate::geometry::{Point, cut_off, normalized, sub};

/// Points that one task searches for, or works on within a span; fixed, so that results do not depend on the number of
/// threads.
pub(super) const POINTS_PER_TASK: usize = 512;
const STRETCH: usize = 2; // reach to both sides over which a curve's direction is taken for poses, spans
pub(super) const DIRECTIONS: usize = 8; // intervals of a span between the places at which it is taken

/// Points of one view on one span.
#[derive(Clone)]
pub(super) struct Run {
    /// The number of the span, counted through all curves.
    pub(super) span: usize,
    /// Positions of its points among the view's sorted points.
    pub(super) points: Range<usize>,
}

/// A place on a span; spans are counted through all curves.
#[derive(Clone, Copy, Default)]
pub(super) struct OnSpan {
    pub(super) span: u32,
    /// The parameter within the span.
    pub(super) t: f32,
}

/// All curves, span by span.
pub(super) struct Spans {
    /// The number of each curve's first span, and the number of all spans.
    pub(super) first: Vec<usize>,
    pub(super) spans: Vec<Span>,
}

/// A cubic c₁ t + c₂ t² + c₃ t³ relative to an origin, in radii.
pub(super) struct Span {
    pub(super) curve: usize,
    /// The number of the span in its curve, and the number of the curve's spans.
    pub(super) number: usize,
    pub(super) count: usize,
    pub(super) origin: Point,
    pub(super) radius: f64,
    pub(super) cubic: [[f32; 3]; 3],
    /// The curve's direction over a longer stretch, at places from 0 to 1.
    pub(super) directions: [[f32; 3]; DIRECTIONS + 1],
    /// The extraction range less a margin for noise, relative to the origin.
    pub(super) bounds: [[f32; 3]; 2],
    pub(super) band: f32,
}

/// Sorts the points that have a place by span; returns their numbers and places. `firsts` holds the curves' first
/// spans.
pub(super) fn sort_by_span<'a>(
    places: impl IntoIterator<Item = &'a Option<OnCurve>>,
    firsts: &[usize],
) -> (Vec<u32>, Vec<OnSpan>) {
    let on_span = |place: OnCurve| {
        let first = firsts[place.curve];
        let number = cut_off(place.parameter).min((firsts[place.curve + 1] - first) as u32 - 1);
        OnSpan { span: first as u32 + number, t: (place.parameter - f64::from(number)) as f32 }
    };
    let (order, starts) =
        (0u32..).zip(places).filter_map(|(i, place)| place.map(|place| (i, on_span(place)))).unzip();
    resort(order, starts, firsts[firsts.len() - 1])
}

/// Sorts points by span; those on one span keep their order.
pub(super) fn resort(order: Vec<u32>, places: Vec<OnSpan>, spans: usize) -> (Vec<u32>, Vec<OnSpan>) {
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

/// Divides sorted points into runs on one span, none longer than a task.
pub(super) fn find_runs(places: &[OnSpan]) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut start = 0;
    while start < places.len() {
        let span = places[start].span;
        let most = &places[start..places.len().min(start + POINTS_PER_TASK)];
        let end = start + most.iter().position(|place| place.span != span).unwrap_or(most.len());
        runs.push(Run { span: span as usize, points: start..end });
        start = end;
    }
    runs
}

/// Pairs each run with its part of the values of all points.
pub(super) fn split_by_run<'a, T>(runs: &'a [Run], mut values: &'a mut [T]) -> Vec<(&'a Run, &'a mut [T])> {
    let part = |run: &'a Run| (run, values.split_off_mut(..run.points.len()).unwrap_or_default());
    runs.iter().map(part).collect()
}

/// Returns the number of each curve's first span, and the number of all spans.
pub(super) fn number_spans(curves: &[Spline]) -> Vec<usize> {
    let mut firsts = vec![0];
    for curve in curves {
        firsts.push(firsts[firsts.len() - 1] + curve.end() as usize);
    }
    firsts
}

impl Spans {
    pub(super) fn new(state: &State, options: &TubeFitOptions, bands: &[f64]) -> Self {
        let mut spans = Vec::new();
        for (curve, spline) in state.curves.iter().enumerate() {
            let pieces = spline.pieces();
            let directions = find_directions(&pieces);
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
                    band: (bands[state.radius_classes[curve]] / radius) as f32,
                });
            }
        }
        Self { first: number_spans(&state.curves), spans }
    }
}

/// Finds a curve's directions at places all along it, each over a longer stretch.
///
/// A fitted curve wavers with the noise of its points, and so do its normals. Along a straight rope, a view could then
/// slide to where the noise fits best, and the normal equations would count that as information. The direction over a
/// longer stretch hardly wavers, and in a bend it is the tangent.
fn find_directions(pieces: &Pieces) -> Vec<Point> {
    // places on both sides of a direction's, at the steps between directions
    let reach = STRETCH * DIRECTIONS;
    let last = pieces.end() as usize * DIRECTIONS;
    let place = |i: usize| {
        let u = (i as f64 - reach as f64) / DIRECTIONS as f64;
        pieces.at(u.clamp(0.0, pieces.end())).position
    };
    let places: Vec<Point> = (0..=last + 2 * reach).map(place).collect();
    places.iter().zip(&places[2 * reach..]).map(|(&before, &after)| normalized(sub(after, before))).collect()
}
