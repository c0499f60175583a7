//! The lift of one view's polylines from the image into space.

use std::ops::Range;

use super::camera::{Plane, RopeView, Sensor};
use super::crossings::{Crossing, Evidence, apart, find_hiding, find_overlaps};
use super::grid::Grid;
use super::order::decide_order;
use super::places::{MIXED, MIXES, OnChain, Place2, STEP};
use super::smoothing::Profile;
use crate::geometry::median::{MEDIAN_TO_SD, median};
use crate::geometry::polyline::{arc_length, resampled};
use crate::geometry::{Point, advance};

const MIN_DEPTHS: usize = 10; // depths away from other strands, at least, that estimate the noise
const TIP: usize = 2; // samples of a chain's tip
const LIES_OVER: f64 = 8.0; // an end lies over or under a strand only if the opposite order costs this much more
/// Length of a rope relative to its apparent length at most; beyond it, the depth is that of other things.
const MAX_STRETCH: f64 = 20.0;
const NOISE: (f64, f64) = (0.15, 2.0); // least and largest noise of depth, radii

/// Polylines in space, and their crossings.
#[derive(Debug, Clone, PartialEq)]
pub struct Lifted {
    /// Nodes of each polyline, world frame, metres.
    pub nodes: Vec<Vec<Point>>,
    /// Noise of depth, radii.
    pub sigma: f64,
    /// Their crossings in the image.
    pub crossings: Vec<Crossing>,
}

/// Gives polylines of a view's image their depth.
///
/// Depth is a smoothing spline of median depths. Where strands hide each other, it skips depths until it is known which
/// is on top. None if no polyline has depth, or all are nearly parallel to the viewing rays.
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
    let seen = |&uv: &Place2| view.medians.at(view.silhouette, uv) / radius - sensor.bias[0];
    let mut depths: Vec<f64> = places.iter().map(seen).collect();
    let middle = median(depths.iter().copied().filter(|z| z.is_finite()).collect())?;

    let reach = MIXES.0 * radius_px + MIXES.1;
    let mut grid = Grid::default();
    grid.fill(&places, view.silhouette.frame(), reach);
    let mut weights: Vec<f64> = depths.iter().map(|z| f64::from(u8::from(z.is_finite()))).collect();
    // beyond a rope's end lies the table
    for range in ranges.iter().filter(|range| range.len() > 4 * TIP) {
        weights[range.start..range.start + TIP].fill(0.0);
        weights[range.end - TIP..range.end].fill(0.0);
    }
    let mut owned = weights.clone();
    let mut mixed = vec![false; places.len()];
    grid.pairs(reach, |i, j, _| {
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
    let pairs = find_hiding(&numbers, &grid, radius_px);
    for &([i, j], _) in &pairs {
        weights[i] = 0.0;
        weights[j] = 0.0;
    }
    if weights.iter().filter(|&&w| w > 0.0).count() <= MIN_DEPTHS {
        weights = everywhere;
    }
    for z in &mut depths {
        *z = if z.is_finite() { *z } else { middle };
    }

    let ceilings: Vec<f64> = places.iter().map(|&uv| find_ceiling(view, uv, radius, plane, sensor)).collect();
    let none = vec![f64::INFINITY; places.len()];
    let mut profile = Profile::new(depths, none, ranges.clone(), sensor.correlation);
    let (mut sigma, mut x) = (sensor.noise.unwrap_or(0.5), Vec::new());
    for _ in 0..2 {
        x = profile.solve(&weights, sigma, &[], &x, 4).0;
        let seen = (0..x.len()).filter(|&i| weights[i] > 0.0);
        let residuals = seen.map(|i| (x[i] - profile.observed[i]).abs()).collect();
        let found = (MEDIAN_TO_SD * median(residuals)?).clamp(NOISE.0, NOISE.1);
        sigma = sensor.noise.unwrap_or(found);
    }
    // if most of the rope would lie below the table, the view is biased
    let seen = (0..places.len()).filter(|&i| weights[i] > 0.0);
    let below = seen.map(|i| (profile.observed[i] - ceilings[i]).max(0.0)).collect();
    let bias = median(below)?;
    for z in profile.observed.iter_mut().chain(&mut x) {
        *z -= bias;
    }
    profile.ceilings = ceilings;
    let found = find_overlaps(&pairs, &places, &numbers);
    let evidence = Evidence { profile: &profile, clear: &weights, owned: &owned, sigma, start: &x };
    let decided = decide_order(&evidence, &found);
    // an end beside a strand touches it and does not cross it, unless depth shows otherwise
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
    if length.is_nan() || length > MAX_STRETCH * STEP * radius * places.len() as f64 {
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

/// Returns the surface depth, radii, at which the axis at a place is a radius above the plane.
fn find_ceiling(view: &RopeView, uv: Place2, radius: f64, plane: Option<Plane>, sensor: &Sensor) -> f64 {
    let Some(plane) = plane else { return f64::INFINITY };
    let camera: Point = view.pose.translation.into();
    let ray = view.turned(view.pinhole.point(uv[0], uv[1], 1.0));
    let fall = plane.height(camera) - plane.height(advance(camera, 1.0, ray));
    if fall <= 1e-3 {
        return f64::INFINITY;
    }
    (plane.height(camera) - radius) / fall / radius - sensor.surface
}
