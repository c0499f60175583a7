//! The ends of ropes, found by counting points.

use crate::checks::{check_finite, check_positive};
use crate::error::{Error, Result};
use crate::geometry::arclength::{ByLength, unit_tangent};
use crate::geometry::median::median;
use crate::geometry::{Point, advance, cut_off, dot, sub};
use crate::simd::LANES;
use crate::tubes::tubefit::Tube;

const BIN: f64 = 0.5; // width of the bins in which points are counted, radii
const NEAR_END: f64 = 7.0; // points nearer than this to an end may also lie on another rope's surface, radii
const INSIDE: [f64; 2] = [1.0, 5.0]; // distances from an end between which the density of points is measured, radii
const REACH: f64 = 1.5; // largest distance of an end from the first full bin, radii
const MAX_RADII: f64 = 1e6; // largest length of a curve, radii
const MIN_POINTS: usize = 8; // points that support a curve at least
const ROUNDS: usize = 3; // estimates of where a view sees an end, each from the one before

/// Surface points and the curves that explain them, in arrays of one length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnTubes<'a> {
    /// Whether each point counts.
    pub inlier: &'a [bool],
    /// The number of its curve.
    pub curve: &'a [i64],
    /// The curve's parameter at its foot point.
    pub parameter: &'a [f64],
    pub position: &'a [Point],
    /// Unit vector to the camera that saw it.
    pub to_camera: &'a [Point],
}

/// Cuts fitted curves to the part that points support: returns the first and the last parameter of each rope, or None.
///
/// Let n be the number of points for each metre of rope, and m the number of points past L₀ − r, where the points end
/// at about L₀. The end is at L₀ − r + m / n. This estimate is unbiased, unlike a threshold on the density.
///
/// Near an end, points may also lie on another curve's surface, and then say nothing about the end. `surface_tolerance`
/// gives for each curve the largest distance from its surface at which points count as on it, metres; the function
/// skips these points. With None it counts all points.
pub(crate) fn rope_extents(
    tubes: &[Tube],
    radii: &[f64],
    points: &OnTubes,
    surface_tolerance: Option<&[f64]>,
) -> Result<Vec<Option<[f64; 2]>>> {
    for &radius in radii {
        check_positive("radii", radius)?;
    }
    for tube in tubes {
        check_finite("curves", &tube.curve.control)?;
    }
    let curves: Vec<ByLength> =
        tubes.iter().map(|tube| ByLength::new(&tube.curve, 0.0, tube.curve.end())).collect();
    for (curve, tube) in curves.iter().zip(tubes) {
        let length = curve.length() / radii[tube.radius_class];
        if length > MAX_RADII {
            return Err(Error::invalid(
                "radii",
                format!("a curve is {length:.1e} radii long, more than {MAX_RADII:e}"),
            ));
        }
    }
    let strands = surface_tolerance.map(|tolerance| (Strands::new(&curves, tubes, radii), tolerance));
    let mut places: Vec<Vec<f64>> = vec![Vec::new(); tubes.len()];
    let mut near_ends: Vec<[Vec<(f64, usize)>; 2]> = vec![Default::default(); tubes.len()];
    for (i, (&number, &parameter)) in points.curve.iter().zip(points.parameter).enumerate() {
        if !points.inlier[i] {
            continue;
        }
        let number = number as usize;
        let curve = &curves[number];
        let s = curve.arc_length(parameter);
        let near = NEAR_END * radii[tubes[number].radius_class];
        if strands.is_some() && s < near {
            near_ends[number][0].push((s, i));
        } else if strands.is_some() && s > curve.length() - near {
            near_ends[number][1].push((s, i));
        } else {
            places[number].push(s);
        }
    }
    if let Some((strands, tolerance)) = &strands {
        for (number, ends) in near_ends.iter().enumerate() {
            for end in ends {
                let own = strands.alone(number, tolerance[number], end, points);
                places[number].extend(own);
            }
        }
    }
    let found = places
        .into_iter()
        .enumerate()
        .map(|(number, s)| {
            if s.len() < MIN_POINTS {
                return None;
            }
            let (curve, radius) = (&curves[number], radii[tubes[number].radius_class]);
            let length = curve.length();
            let start = find_end(&s, length, radius);
            let backwards: Vec<f64> = s.iter().map(|s| length - s).collect();
            let stop = length - find_end(&backwards, length, radius);
            (stop - start > radius).then(|| [curve.parameter(start), curve.parameter(stop)])
        })
        .collect();
    Ok(found)
}

/// Returns the arc length at which points begin; `s` holds the points' arc lengths, at least two, in any order.
fn find_end(s: &[f64], length: f64, radius: f64) -> f64 {
    let width = BIN * radius;
    let bins = (length / width) as usize + 1;
    let mut counts = vec![0.0; bins];
    for s in s {
        counts[(cut_off(s / width) as usize).min(bins - 1)] += 1.0;
    }
    let typical = median(counts.iter().copied().filter(|&count| count > 0.0).collect()).unwrap_or(0.0);
    let full = |&i: &usize| {
        let density = median(counts[i + 1..bins.min(i + 9)].to_vec()).unwrap_or(0.0).max(0.3 * typical);
        counts[i] >= 0.4 * density && counts[i] + counts[i + 1] >= 0.8 * density
    };
    let first = (0..bins - 1).find(full).unwrap_or(0);
    let about = (first as f64 + 0.5) * width;
    let near = about + INSIDE[0] * radius;
    let far = (about + INSIDE[1] * radius).min(length - about).max(near + radius);
    let within = |low: f64, high: f64| s.iter().filter(|&&s| low <= s && s < high).count();
    let inside = within(near, far);
    let beyond = s.iter().filter(|&&s| about - REACH * radius < s && s < near).count();
    if inside == 0 {
        return about;
    }
    let density = inside as f64 / (far - near);
    // another strand may occlude part of the inside and lower the density: no end lies beyond all points
    let second = find_second(s);
    let end = (near - beyond as f64 / density).max(second - 1.0 / density);
    end.max((about - REACH * radius).max(0.0)).min(about + REACH * radius)
}

/// How a view sees an end of a rope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SeenEnd {
    /// How far outside the expected place its points end, metres.
    pub offset: f64,
    /// The points on the stretch inside.
    pub count: usize,
    /// The length of this stretch, metres.
    pub length: f64,
}

/// Finds where the points that one view saw of a rope end, by their weight past a place inside.
///
/// `inwards` says how far inside the expected end each point lies. The stretch between the two distances of `inside`
/// gives the weight per length. None if that stretch has less than `fewest` points, or if the end is farther than
/// `most` from the expected place.
pub(crate) fn find_seen_end(
    inwards: &[f64],
    weights: &[f64],
    inside: [f64; 2],
    most: f64,
    fewest: usize,
) -> Option<SeenEnd> {
    let mut found = SeenEnd { offset: 0.0, count: 0, length: 0.0 };
    for _ in 0..ROUNDS {
        let [near, far] = inside.map(|distance| distance - found.offset);
        (found.count, found.length) = (0, far - near);
        let (mut body, mut beyond) = (0.0, 0.0);
        for (&s, &weight) in inwards.iter().zip(weights) {
            if s < near {
                beyond += weight;
            } else if s < far {
                body += weight;
                found.count += 1;
            }
        }
        if found.count < fewest {
            return None;
        }
        found.offset = beyond / (body / found.length) - near;
        if found.offset.abs() > most {
            return None;
        }
    }
    Some(found)
}

/// Returns the second smallest of at least two numbers.
fn find_second(values: &[f64]) -> f64 {
    // lane by lane, so that no comparison waits for the one before
    let (mut first, mut second) = ([f64::INFINITY; LANES], [f64::INFINITY; LANES]);
    for values in values.chunks(LANES) {
        for (l, &value) in values.iter().enumerate() {
            second[l] = second[l].min(first[l].max(value));
            first[l] = first[l].min(value);
        }
    }
    let mut least = [first, second].concat();
    *least.select_nth_unstable_by(1, f64::total_cmp).1
}

/// A place on a strand's axis.
struct Node {
    curve: usize,
    s: f64,
    position: Point,
    tangent: Point,
    radius: f64,
}

/// Places along all curves, to find other strands that a point may belong to.
struct Strands {
    nodes: Vec<Node>,
    radii: Vec<f64>,
    widest: f64,
}

impl Strands {
    fn new(curves: &[ByLength], tubes: &[Tube], radii: &[f64]) -> Self {
        let radii_of: Vec<f64> = tubes.iter().map(|tube| radii[tube.radius_class]).collect();
        let mut nodes = Vec::new();
        for (number, (curve, &radius)) in curves.iter().zip(&radii_of).enumerate() {
            for s in curve.nodes(0.25 * radius) {
                let place = curve.at(s);
                let (position, tangent) = (place.position, unit_tangent(&place));
                nodes.push(Node { curve: number, s, position, tangent, radius });
            }
        }
        Self { nodes, widest: radii.iter().copied().fold(0.0, f64::max), radii: radii_of }
    }

    /// Returns the arc lengths of a curve's points near one end that lie on no other strand's surface.
    fn alone(&self, curve: usize, tolerance: f64, at_end: &[(f64, usize)], points: &OnTubes) -> Vec<f64> {
        let r = self.radii[curve];
        let reach = 1.3 * self.widest + tolerance;
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for &(_, i) in at_end {
            for k in 0..3 {
                low[k] = low[k].min(points.position[i][k] - reach);
                high[k] = high[k].max(points.position[i][k] + reach);
            }
        }
        let near: Vec<&Node> = (self.nodes.iter())
            .filter(|node| (0..3).all(|k| node.position[k] > low[k] && node.position[k] < high[k]))
            .collect();
        let shared = |&(here, i): &(f64, usize)| {
            near.iter().any(|node| {
                if node.curve == curve && (node.s - here).abs() <= 5.0 * r {
                    return false;
                }
                let offset = sub(points.position[i], node.position);
                let lengthwise = dot(offset, node.tangent);
                if lengthwise.abs() >= 0.3 * r {
                    return false;
                }
                let across = advance(offset, -lengthwise, node.tangent);
                let distance = dot(across, across).sqrt();
                (distance - node.radius).abs() < tolerance
                    && dot(across, points.to_camera[i]) > -0.1 * distance
            })
        };
        at_end.iter().filter(|point| !shared(point)).map(|&(s, _)| s).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::spline::Spline;

    /// Returns the axis of a tube along x, from 0.
    fn straight(length: f64, spans: usize) -> Spline {
        let step = length / spans as f64;
        Spline { control: (0..spans + 3).map(|i| [(i as f64 - 1.0) * step, 0.0, 0.0]).collect() }
    }

    /// Returns points on top of a straight tube of radius 1 along x, from 3 to 37.
    fn on_top(tube: &Tube) -> (Vec<f64>, Vec<Point>) {
        let whole = ByLength::new(&tube.curve, 0.0, tube.curve.end());
        let x: Vec<f64> = (0..340).map(|i| 3.05 + 0.1 * f64::from(i)).collect();
        (x.iter().map(|&x| whole.parameter(x)).collect(), x.iter().map(|&x| [x, 0.0, 1.0]).collect())
    }

    /// Returns the extents of tubes of radius 1, with the points of `on_top` for which `inlier` holds.
    fn extents(
        tubes: &[Tube],
        radius: f64,
        inlier: impl Fn(usize, Point) -> bool,
        surface_tolerance: Option<&[f64]>,
    ) -> Result<Vec<Option<[f64; 2]>>> {
        let (parameter, position) = on_top(&tubes[0]);
        let inlier: Vec<bool> = position.iter().enumerate().map(|(i, &p)| inlier(i, p)).collect();
        let (curve, to_camera) = (vec![0; inlier.len()], vec![[0.0, 0.0, 1.0]; inlier.len()]);
        let points = OnTubes {
            inlier: &inlier,
            curve: &curve,
            parameter: &parameter,
            position: &position,
            to_camera: &to_camera,
        };
        rope_extents(tubes, &[radius], &points, surface_tolerance)
    }

    #[test]
    fn a_view_sees_an_end_where_its_points_stop() {
        // 40 points for each radius of rope, up to 0.3 radii outside; pixels of the outer ones see half as much
        let inwards: Vec<f64> = (0..400).map(|i| f64::from(i) / 40.0 - 0.3).collect();
        let found = find_seen_end(&inwards, &vec![2.0; 400], [1.0, 4.0], 1.8, 12).unwrap();
        assert!(
            (found.offset - 0.3).abs() < 0.05 && found.count == 120 && (found.length - 3.0).abs() < 1e-12
        );
        let weights: Vec<f64> = inwards.iter().map(|&s| if s < 0.7 { 1.0 } else { 2.0 }).collect();
        let short = find_seen_end(&inwards, &weights, [1.0, 4.0], 1.8, 12).unwrap();
        assert!((short.offset + 0.2).abs() < 0.05);
        assert_eq!(find_seen_end(&inwards, &weights, [1.0, 4.0], 0.1, 12), None);
        assert_eq!(find_seen_end(&inwards[..50], &weights, [1.0, 4.0], 1.8, 12), None);
    }

    #[test]
    fn a_rope_is_as_long_as_its_points_are() {
        let tubes = [Tube { curve: straight(40.0, 16), radius_class: 0 }];
        for tolerance in [None, Some(&[0.15][..])] {
            let parts = extents(&tubes, 1.0, |_, _| true, tolerance).unwrap();
            let [start, stop] = parts[0].unwrap().map(|u| u * 2.5);
            assert!((start - 3.0).abs() < 0.1 && (stop - 37.0).abs() < 0.1, "{start} {stop}");
        }
        assert_eq!(extents(&tubes, 1.0, |i, _| i < 7, None).unwrap(), [None]);
        // the bins of a rope this thin would fill the memory
        assert!(extents(&tubes, 1e-9, |_, _| true, None).is_err());
    }

    #[test]
    fn points_on_another_strand_too_do_not_count_for_an_end() {
        let across = Spline { control: (0..9).map(|i| [36.5, 2.5 * f64::from(i - 4), 0.0]).collect() };
        let tubes =
            [Tube { curve: straight(40.0, 16), radius_class: 0 }, Tube { curve: across, radius_class: 0 }];
        let seen = |_, [x, _, _]: Point| !(34.0..=36.2).contains(&x);
        let stop = |tolerance| extents(&tubes, 1.0, seen, tolerance).unwrap()[0].unwrap()[1] * 2.5;
        assert!(stop(None) > 34.5);
        assert!(stop(Some(&[0.15, 0.15])) < 34.3);
    }
}
