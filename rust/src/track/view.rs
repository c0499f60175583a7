//! Samples of ropes as one camera sees them.

use super::camera::Camera;
use super::rope::{Rope, SAMPLES, Weights, length};
use crate::geometry::Point;
use crate::geometry::{advance, cross, dot, normalized};

const NEAREST: f64 = 0.05; // metres: samples count as no nearer to the camera
const MIN_SINE: f64 = 1e-6; // of the angle between rope and ray

/// The samples of all ropes, one rope after the other.
pub struct Samples {
    /// First sample of each rope, and the end of the last.
    pub starts: Vec<usize>,
    pub weights: Vec<Weights>,
    /// Rope of each sample.
    pub rope: Vec<usize>,
    /// Radius of its rope, metres.
    pub radius: Vec<f64>,
    /// Arc length from sample to sample, metres.
    pub step: Vec<f64>,
}

impl Samples {
    pub fn new(ropes: &[Rope]) -> Self {
        let mut all = Self { starts: vec![0], weights: vec![], rope: vec![], radius: vec![], step: vec![] };
        for (number, rope) in ropes.iter().enumerate() {
            all.weights.extend(Weights::all(rope.len()));
            let end = all.weights.len();
            all.rope.resize(end, number);
            all.radius.resize(end, rope.radius);
            all.step.resize(end, rope.spacing / SAMPLES as f64);
            all.starts.push(end);
        }
        all
    }

    pub fn len(&self) -> usize {
        self.weights.len()
    }
}

/// How a camera sees each sample. Directions and places are in the camera's frame.
pub struct Seen {
    pub places: Vec<Point>,
    pub tangents: Vec<Point>,
    /// Across the rope and the ray.
    pub lateral: Vec<Point>,
    /// Across the rope, away from the camera.
    pub deep: Vec<Point>,
    pub rays: Vec<Point>,
    /// Of the angle between rope and ray.
    pub sine: Vec<f64>,
    /// Columns and rows, pixels.
    pub pixels: Vec<[f64; 2]>,
    /// Pixels that a metre along the rope moves in the image.
    pub along: Vec<[f64; 2]>,
}

impl Seen {
    pub fn new(camera: &Camera<'_>, samples: &Samples, ropes: &[Rope]) -> Self {
        let count = samples.len();
        let mut seen = Self {
            places: Vec::with_capacity(count),
            tangents: Vec::with_capacity(count),
            lateral: Vec::with_capacity(count),
            deep: Vec::with_capacity(count),
            rays: Vec::with_capacity(count),
            sine: Vec::with_capacity(count),
            pixels: Vec::with_capacity(count),
            along: Vec::with_capacity(count),
        };
        let [fx, fy] = camera.pinhole.focal;
        for (weights, &number) in samples.weights.iter().zip(&samples.rope) {
            let rope = &ropes[number];
            let mut world = weights.place(&rope.nodes);
            if camera.delay != 0.0 {
                world = advance(world, camera.delay, weights.place(&rope.velocities));
            }
            let mut place = camera.see(world);
            place[2] = place[2].max(NEAREST);
            let tangent = normalized(camera.turn_back(weights.direction(&rope.nodes)));
            let ray = normalized(place);
            let lateral = cross(tangent, ray);
            let sine = length(lateral).max(MIN_SINE);
            let lateral = lateral.map(|x| x / sine);
            seen.pixels.push(camera.project(place));
            seen.along.push([
                (tangent[0] - place[0] / place[2] * tangent[2]) * fx / place[2],
                (tangent[1] - place[1] / place[2] * tangent[2]) * fy / place[2],
            ]);
            seen.places.push(place);
            seen.deep.push(cross(lateral, tangent));
            seen.tangents.push(tangent);
            seen.rays.push(ray);
            seen.lateral.push(lateral);
            seen.sine.push(sine);
        }
        seen
    }

    /// Returns the pixels across a rope's radius at a sample.
    pub fn width(&self, camera: &Camera<'_>, sample: usize, radius: f64) -> f64 {
        radius * camera.pinhole.focal[0] / self.places[sample][2]
    }

    /// Returns where a place lies from a sample: across, deep and along the rope, metres.
    pub fn split(&self, sample: usize, place: Point) -> [f64; 3] {
        let s = self.places[sample];
        let q = [place[0] - s[0], place[1] - s[1], place[2] - s[2]];
        [dot(q, self.lateral[sample]), dot(q, self.deep[sample]), dot(q, self.tangents[sample])]
    }
}
