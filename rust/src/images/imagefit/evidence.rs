//! The residuals of one view's mask and depth.

use super::camera::{RopeView, Sensor};
use super::crossings::apart;
use super::curves::Curves;
use super::equations::{Columns, Residual, Sums};
use super::grid::Grid;
use super::places::{HIDES, MIXED, MIXES, Place2, STEP};
use crate::geometry::median::upper_median;
use crate::geometry::polyline::append_directions;
use crate::geometry::{Point, cross, dot};

const EDGE_PIXELS: f64 = 16.0; // edge pixels whose errors are correlated
const ROUNDNESS: f64 = 0.04; // deviation of a rope's outline from a circle, radii
/// An edge belongs to another strand if the cosine between its normal and the rope's direction is larger.
const MAX_ALONG: f64 = 0.45;
const MIN_INSIDE: f64 = 0.85; // depth of samples inside the mask at least, image radii
const INSIDE_WEIGHT: f64 = 8.0; // weight of that, for each radius of length
const END_WEIGHT: f64 = 10.0; // weight with which ends stay in place
const HUBER: f64 = 1.5; // larger depth residuals count linearly, not squared, standard deviations
const MIN_DEPTH: f64 = 1e-3; // distance of a rope from a camera at least, metres

/// The samples as one view sees them.
#[derive(Debug, Default)]
pub struct Seen {
    /// Positions in the corrected camera frame.
    pub places: Vec<Point>,
    pub image: Vec<Place2>,
    /// Directions along the rope, in the image and in the camera frame.
    directions: Vec<Place2>,
    spatial: Vec<Point>,
    /// The rope's radius in the image, pixels.
    pub radii: Vec<f64>,
    /// Whether no other strand hides the sample.
    pub visible: Vec<bool>,
    /// Whether another strand is near enough to change its depth.
    pub mixed: Vec<bool>,
    /// The last depth residuals; NaN without depth or with another strand mixed in.
    pub depth_errors: Vec<f64>,
    /// The last distances of edges from the tube's outline, pixels.
    pub edge_errors: Vec<f64>,
    grid: Grid,
    /// For each place on the edge, the last nearest sample.
    nearest: Vec<u32>,
    votes: Vec<Vote>,
}

/// A place on the edge that votes for the axis at a sample.
#[derive(Debug)]
struct Vote {
    edge: usize,
    sample: usize,
    /// Distance of the axis from the place that it votes for, along the edge's normal, rope's radii.
    away: f64,
    /// The rope's radius in the image there, pixels.
    radius: f64,
}

/// The inputs of one view's residuals.
pub struct Scene<'a> {
    pub view: &'a RopeView<'a>,
    pub columns: Columns,
    pub curves: &'a Curves,
    /// Unit vectors along the rope, world frame.
    pub tangents: &'a [Point],
    pub radius: f64,
    pub sensor: &'a Sensor,
}

impl Seen {
    /// Projects the samples into the view.
    pub fn update(&mut self, view: &RopeView, correction: &[f64; 6], positions: &[Point], curves: &Curves) {
        self.places.clear();
        self.places.extend(positions.iter().map(|&x| {
            let y = view.corrected(correction, x);
            [y[0], y[1], y[2].max(MIN_DEPTH)]
        }));
        self.image.clear();
        self.image.extend(self.places.iter().map(|&y| view.projected(y)));
        self.directions.clear();
        self.spatial.clear();
        for chain in &curves.chains {
            append_directions(&self.image[chain.clone()], &mut self.directions);
            append_directions(&self.places[chain.clone()], &mut self.spatial);
        }
        // the radius was measured at the mask's median depth
        let depths: Vec<f64> = self.places.iter().map(|y| y[2]).collect();
        let middle = upper_median(&depths).unwrap_or(MIN_DEPTH);
        let radius_px = view.silhouette.radius_px;
        self.radii.clear();
        self.radii.extend(self.places.iter().map(|y| radius_px * middle / y[2]));

        let reach = MIXES.0 * radius_px + MIXES.1;
        self.grid.fill(&self.image, view.silhouette.frame(), reach);
        self.visible.clear();
        self.visible.resize(positions.len(), true);
        self.mixed.clear();
        self.mixed.resize(positions.len(), false);
        let hides = (HIDES * radius_px).powi(2);
        self.grid.pairs(reach, |i, j, d| {
            if apart([curves.numbers[i], curves.numbers[j]], [i, j]) {
                self.mixed[i] = true;
                self.mixed[j] = true;
                if d < hides {
                    let behind = if self.places[i][2] < self.places[j][2] { j } else { i };
                    self.visible[behind] = false;
                }
            }
        });
    }

    /// Makes a residual whose derivative by the sample's place in the camera frame is `by_seen`. Data never slide a
    /// sample along the rope.
    #[inline]
    fn residual(&self, scene: &Scene, i: usize, by_seen: Point, value: f64, weight: f64) -> Residual {
        let by_world = scene.view.turned(by_seen);
        let t = scene.tangents[i];
        let along = dot(by_world, t);
        let turn = cross(self.places[i], by_seen);
        Residual {
            value,
            weight,
            by_place: std::array::from_fn(|k| by_world[k] - along * t[k]),
            by_pose: [turn[0], turn[1], turn[2], by_seen[0], by_seen[1], by_seen[2]],
            by_bias: 0.0,
        }
    }

    /// Returns the derivative of a place in the image, along the direction d, by the sample's place in the camera
    /// frame.
    #[inline]
    fn by_seen(&self, scene: &Scene, i: usize, d: Place2) -> Point {
        let [x, y, z] = self.places[i];
        let [fu, fv] = scene.view.pinhole.focal;
        [fu * d[0] / z, fv * d[1] / z, -(fu * d[0] * x + fv * d[1] * y) / (z * z)]
    }

    /// Finds the samples that the mask's edge votes for: axes a radius inside. Votes farther than `limit` image radii do
    /// not count.
    pub fn find_votes(&mut self, view: &RopeView, curves: &Curves, limit: f64) {
        let silhouette = view.silhouette;
        let radius_px = silhouette.radius_px;
        let reach = 2.5 * radius_px;
        self.nearest.resize(silhouette.boundary.len(), u32::MAX);
        self.votes.clear();
        // the sample near one edge is often near the next
        let mut before = None;
        for (b, edge) in silhouette.boundary.iter().enumerate() {
            if self.nearest[b] as usize >= self.radii.len() {
                match self.grid.nearest(edge.at, reach, before) {
                    Some(k) => self.nearest[b] = k as u32,
                    None => continue,
                }
            }
            let normal = edge.normal;
            let last = self.nearest[b] as usize;
            let radius = self.radii[last];
            let vote = [edge.at[0] - radius * normal[0], edge.at[1] - radius * normal[1]];
            let Some(k) = self.grid.nearest(vote, 1.5 * limit * radius_px, Some((last, self.image[last])))
            else {
                self.nearest[b] = u32::MAX;
                continue;
            };
            self.nearest[b] = k as u32;
            let at = self.image[k];
            before = Some((k, at));
            let e = ((vote[0] - at[0]) * normal[0] + (vote[1] - at[1]) * normal[1]) / radius;
            let along = self.directions[k][0] * normal[0] + self.directions[k][1] * normal[1];
            let chain = &curves.chains[curves.numbers[k] as usize];
            if along.abs() < MAX_ALONG && e.abs() < limit && k != chain.start && k + 1 != chain.end {
                self.votes.push(Vote { edge: b, sample: k, away: e, radius });
            }
        }
    }

    /// Adds the votes that were found with `limit`.
    pub fn add_edge(&mut self, scene: &Scene, limit: f64, sums: &mut Sums) {
        let silhouette = scene.view.silhouette;
        let lateral = scene.sensor.lateral / silhouette.radius_px;
        let unit = 1.0 / EDGE_PIXELS / (lateral.powi(2) + ROUNDNESS * ROUNDNESS);
        self.edge_errors.clear();
        for &Vote { edge, sample, away, radius } in &self.votes {
            let edge = &silhouette.boundary[edge];
            self.edge_errors.push(away * radius);
            let tukey = (1.0 - (away / limit).powi(2)).powi(2);
            let d = self.by_seen(scene, sample, edge.normal.map(|n| -n / radius));
            let residual = self.residual(scene, sample, d, away, tukey * unit * edge.weight);
            sums.add(sample, scene.columns, &residual);
        }
    }

    /// Keeps the tube inside the mask, hidden parts included.
    pub fn add_inside(&self, scene: &Scene, sums: &mut Sums) {
        let silhouette = scene.view.silhouette;
        for (i, sample) in scene.curves.samples.iter().enumerate() {
            let missing = MIN_INSIDE - silhouette.distance(self.image[i]) / self.radii[i];
            if missing <= 0.0 || sample.capped || silhouette.hidden(self.image[i]) {
                continue;
            }
            let e = missing.min(3.0);
            // only across the rope: where the rope leaves the mask, a pull along it would turn it aside
            let gradient = silhouette.gradient(self.image[i]);
            let along = self.directions[i];
            let part = gradient[0] * along[0] + gradient[1] * along[1];
            let across: Place2 = std::array::from_fn(|k| gradient[k] - part * along[k]);
            let d = self.by_seen(scene, i, across.map(|g| -g / self.radii[i]));
            let weight = INSIDE_WEIGHT * STEP / e.max(1.0);
            sums.add(i, scene.columns, &self.residual(scene, i, d, e, weight));
        }
    }

    /// Keeps the ends in place in the image, along the rope.
    pub fn add_ends(&self, scene: &Scene, ends: &[Place2], sums: &mut Sums) {
        for (i, end) in scene.curves.ends().zip(ends) {
            let along = self.directions[i].map(|d| d / self.radii[i]);
            let e = (self.image[i][0] - end[0]) * along[0] + (self.image[i][1] - end[1]) * along[1];
            let d = self.by_seen(scene, i, along);
            let residual = self.residual(scene, i, d, e, END_WEIGHT);
            sums.add(i, scene.columns, &Residual { by_place: scene.view.turned(d), ..residual });
        }
    }

    /// Adds depth where no other strand hides the sample; its noise and the view's bias are in radii.
    pub fn add_depth(&mut self, scene: &Scene, noise: f64, bias: f64, sums: &mut Sums) {
        let unit = STEP / scene.sensor.correlation / (noise * noise);
        self.depth_errors.clear();
        self.depth_errors.resize(self.places.len(), f64::NAN);
        for i in 0..self.places.len() {
            // beyond a rope's end lies the table
            if !self.visible[i] || scene.curves.samples[i].capped {
                continue;
            }
            let observed = scene.view.medians.at(scene.view.silhouette, self.image[i]);
            let place = self.places[i];
            let cosine = dot(self.spatial[i], place).powi(2) / dot(place, place);
            let sine = (1.0 - cosine).clamp(0.15, 1.0).sqrt();
            let e = (place[2] - observed) / scene.radius - scene.sensor.surface / sine - bias;
            if !e.is_finite() {
                continue;
            }
            if !self.mixed[i] {
                self.depth_errors[i] = e;
            }
            let mixed = if self.mixed[i] { MIXED } else { 1.0 };
            let weight = mixed * unit / (e.abs() / noise / HUBER).max(1.0);
            let residual = self.residual(scene, i, [0.0, 0.0, 1.0 / scene.radius], e, weight);
            sums.add(i, scene.columns, &Residual { by_bias: -1.0, ..residual });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Rope, view};
    use super::*;
    use crate::geometry::sub;

    /// A residual's derivatives by the sample's position and by the pose equal finite differences.
    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let rope = Rope::bent(0.004);
        let seen_by = view(std::slice::from_ref(&rope), [0.02, -0.15, 0.5], 0.3);
        let view = seen_by.rope_view();
        let curves = Curves::through(std::slice::from_ref(&rope.nodes), rope.radius);
        let (mut positions, mut tangents) = (Vec::new(), Vec::new());
        curves.place(&mut positions, &mut tangents);
        let scene = Scene {
            view: &view,
            columns: Columns { pose: Some(0), bias: 6 },
            curves: &curves,
            tangents: &tangents,
            radius: rope.radius,
            sensor: &Sensor::DEFAULT,
        };
        // small turns are treated as vectors, so start without one
        let correction = [0.0; 6];
        let value = |correction: &[f64; 6], positions: &[Point], i: usize, d: Place2| {
            let mut seen = Seen::default();
            seen.update(&view, correction, positions, &curves);
            let [u, v] = seen.image[i];
            d[0] * u + d[1] * v
        };
        let mut seen = Seen::default();
        seen.update(&view, &correction, &positions, &curves);
        let h = 1e-6;
        for (i, d) in [(7, [0.3, 0.1]), (20, [-0.1, 0.4]), (positions.len() - 2, [0.2, 0.2])] {
            let found = seen.residual(&scene, i, seen.by_seen(&scene, i, d), 0.0, 1.0);
            for k in 0..6 {
                let moved = |step: f64| {
                    let mut other = correction;
                    other[k] += step;
                    value(&other, &positions, i, d)
                };
                let slope = (moved(h) - moved(-h)) / (2.0 * h);
                assert!((found.by_pose[k] - slope).abs() < 0.01 * slope.abs().max(1.0), "{k}: {slope}");
            }
            // only across the rope; along it, nothing moves
            assert!(dot(found.by_place, tangents[i]).abs() < 1e-9);
            let ray = sub(positions[i], view.pose.translation.into());
            let across = crate::geometry::normalized(cross(ray, tangents[i]));
            let moved = |step: f64| {
                let mut other = positions.clone();
                other[i] = crate::geometry::advance(other[i], step, across);
                value(&correction, &other, i, d)
            };
            let slope = (moved(h) - moved(-h)) / (2.0 * h);
            let expected = dot(found.by_place, across);
            assert!((expected - slope).abs() < 0.01 * slope.abs().max(1.0), "{expected} for {slope}");
        }
    }
}
