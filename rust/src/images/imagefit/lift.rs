//! The lift of polylines of one view's image into space.

use std::ops::Range;

use super::crossings::{Crossing, Evidence, apart, hiding, overlaps};
use super::grid::Grid;
use super::smoothing::Profile;
use super::{HIDES, MIXED, MIXES, OnChain, Place2, Plane, RopeView, STEP, Sensor};
use crate::geometry::median::median;
use crate::geometry::polyline::{arc_length, resampled};
use crate::geometry::{Point, advance};

/// Fewest depths on their own, away from other strands, that noise is judged by.
const FEWEST: usize = 10;
/// Samples this near to a chain's end are its tip.
const TIP: usize = 2;
/// An end lies over or under a strand if the opposite order costs more than this.
const LIES_OVER: f64 = 8.0;
/// Ropes are at most this much longer than they look: else their depth is that of other things.
const STEEPEST: f64 = 20.0;
/// Least and most noise, radii.
const NOISE: (f64, f64) = (0.15, 2.0);

/// Polylines in space, and how they lie over each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Lifted {
    /// For each polyline its nodes in the world frame, metres.
    pub nodes: Vec<Vec<Point>>,
    /// Noise of depth, radii.
    pub sigma: f64,
    /// Where they cross in the image.
    pub crossings: Vec<Crossing>,
}

/// Gives polylines of a view's image their depth.
///
/// A smoothing spline of median depths, which leaves out where strands hide each other until it is known which is on
/// top. None if no polyline has a depth, or they all but run along the rays.
pub fn lift(
    view: &RopeView,
    chains: &[Vec<Place2>],
    radius: f64,
    plane: Option<Plane>,
    sensor: &Sensor,
) -> Option<Lifted> {
    let radius_px = view.silhouette.radius_px;
    let chains: Vec<Vec<Place2>> = chains.iter().map(|chain| resampled(chain, STEP * radius_px)).collect();
    let places: Vec<Place2> = chains.concat();
    let (mut ranges, mut numbers): (Vec<Range<usize>>, Vec<u32>) = (Vec::new(), Vec::new());
    for (number, chain) in chains.iter().enumerate() {
        ranges.push(numbers.len()..numbers.len() + chain.len());
        numbers.resize(numbers.len() + chain.len(), number as u32);
    }
    let seen = |&uv: &Place2| view.medians.at(uv) / radius - sensor.bias[0];
    let mut depths: Vec<f64> = places.iter().map(seen).collect();
    let middle = median(depths.iter().copied().filter(|z| z.is_finite()).collect())?;

    let reach = MIXES.0 * radius_px + MIXES.1;
    let mut grid = Grid::default();
    grid.fill(&places, view.silhouette.frame(), reach.max(HIDES * radius_px));
    let mut weights: Vec<f64> = depths.iter().map(|z| f64::from(u8::from(z.is_finite()))).collect();
    // beyond a rope's end there is table
    for range in ranges.iter().filter(|range| range.len() > 4 * TIP) {
        weights[range.start..range.start + TIP].fill(0.0);
        weights[range.end - TIP..range.end].fill(0.0);
    }
    let mut owned = weights.clone();
    let mut mixed = vec![false; places.len()];
    grid.pairs(&places, reach, |i, j, _| {
        if apart([numbers[i], numbers[j]], [i, j]) {
            mixed[i] = true;
            mixed[j] = true;
        }
    });
    for i in (0..places.len()).filter(|&i| mixed[i]) {
        weights[i] *= MIXED;
        owned[i] *= MIXED;
    }
    let everywhere = weights.clone();
    let pairs = hiding(&places, &numbers, &grid, radius_px);
    for &([i, j], _) in &pairs {
        weights[i] = 0.0;
        weights[j] = 0.0;
    }
    if weights.iter().filter(|&&w| w > 0.0).count() <= FEWEST {
        weights = everywhere;
    }
    for z in &mut depths {
        *z = if z.is_finite() { *z } else { middle };
    }

    let ceilings: Vec<f64> = places.iter().map(|&uv| ceiling(view, uv, radius, plane, sensor)).collect();
    let none = vec![f64::INFINITY; places.len()];
    let mut profile = Profile::new(depths, none, ranges.clone(), sensor.correlation);
    let (mut sigma, mut x) = (sensor.noise.unwrap_or(0.5), Vec::new());
    for _ in 0..2 {
        x = profile.solve(&weights, sigma, &[], &x, 4).0;
        let seen = (0..x.len()).filter(|&i| weights[i] > 0.0);
        let residuals = seen.map(|i| (x[i] - profile.observed[i]).abs()).collect();
        let found = (1.4826 * median(residuals)?).clamp(NOISE.0, NOISE.1);
        sigma = sensor.noise.unwrap_or(found);
    }
    // what the table forbids to most of the rope is the view's bias
    let seen = (0..places.len()).filter(|&i| weights[i] > 0.0);
    let below = seen.map(|i| (profile.observed[i] - ceilings[i]).max(0.0)).collect();
    let bias = median(below)?;
    for z in profile.observed.iter_mut().chain(&mut x) {
        *z -= bias;
    }
    profile.ceilings = ceilings;
    let found = overlaps(&pairs, &places, &numbers);
    let evidence = Evidence { profile: &profile, clear: &weights, owned: &owned, sigma, start: &x };
    let decided = evidence.decide(&found);
    // an end beside a strand touches it rather than crosses it, unless depth says otherwise
    let at_end = |i: usize| {
        let range = &ranges[numbers[i] as usize];
        i < range.start + TIP || i + TIP >= range.end
    };
    let order: Vec<Option<bool>> = found
        .iter()
        .zip(&decided)
        .map(|(overlap, &(first, margin))| {
            let touches = overlap.sides.iter().flatten().any(|&i| at_end(i));
            (!touches || margin > LIES_OVER).then_some(first)
        })
        .collect();
    let (x, _) = evidence.solve(&found, &order, 5);

    let lifted = |i: usize| {
        let z = (x[i] + sensor.surface) * radius;
        let [u, v] = places[i];
        view.pose.apply(view.pinhole.point(u, v, z))
    };
    let nodes: Vec<Vec<Point>> = ranges.iter().map(|r| r.clone().map(lifted).collect()).collect();
    let arcs: Vec<Vec<f64>> = nodes.iter().map(|nodes| arc_length(nodes)).collect();
    let length: f64 = arcs.iter().map(|arc| arc[arc.len() - 1]).sum();
    if length > STEEPEST * STEP * radius * places.len() as f64 {
        return None;
    }
    let place = |i: usize| {
        let chain = numbers[i] as usize;
        let arc = &arcs[chain];
        OnChain { chain, share: arc[i - ranges[chain].start] / arc[arc.len() - 1] }
    };
    let crossings = found
        .iter()
        .zip(decided)
        .zip(&order)
        .filter(|(_, order)| order.is_some())
        .map(|((overlap, (first_on_top, margin)), _)| Crossing {
            pairs: overlap.pairs.iter().map(|p| p.0.map(place)).collect(),
            first_on_top,
            margin,
        })
        .collect();
    Some(Lifted { nodes, sigma, crossings })
}

/// The depth of the surface, radii, at which the axis seen in a place is a radius above the plane.
fn ceiling(view: &RopeView, uv: Place2, radius: f64, plane: Option<Plane>, sensor: &Sensor) -> f64 {
    let Some(plane) = plane else { return f64::INFINITY };
    let camera: Point = view.pose.translation.into();
    let ray = view.turned(view.pinhole.point(uv[0], uv[1], 1.0));
    let fall = plane.height(camera) - plane.height(advance(camera, 1.0, ray));
    if fall <= 1e-3 {
        return f64::INFINITY;
    }
    (plane.height(camera) - radius) / fall / radius - sensor.surface
}
