//! The curves of a fit: control points, samples, and the cost of bending.

use std::ops::Range;

use super::places::{OnChain, STEP};
use crate::geometry::band::Band;
use crate::geometry::bordered::Bordered;
use crate::geometry::polyline::{arc_length, resampled, smoothed};
use crate::geometry::spline::Spline;
use crate::geometry::{Point, advance, normalized};

const SPAN: f64 = 1.5; // length of a span, radii
const CAP: f64 = 1.2; // length of the cap at each end, radii
/// Integrals over a span of products of the second derivatives of a uniform cubic B-spline's four pieces.
const SECOND: [[f64; 4]; 4] = [
    [1.0 / 3.0, -0.5, 0.0, 1.0 / 6.0],
    [-0.5, 1.0, -0.5, 0.0],
    [0.0, -0.5, 1.0, -0.5],
    [1.0 / 6.0, 0.0, -0.5, 1.0 / 3.0],
];
const THIRD: [f64; 4] = [-1.0, 3.0, -3.0, 1.0]; // third derivatives of the four pieces

/// A sample: the weights of its four control points, for the position and for the derivative by the parameter.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// The first control point.
    pub first: usize,
    pub weights: [f64; 4],
    slopes: [f64; 4],
    /// Whether it lies in an end's cap, beyond which there is no rope.
    pub capped: bool,
}

/// Uniform cubic B-splines, one for each chain, with samples half a radius apart.
#[derive(Debug, Clone)]
pub struct Curves {
    /// Control points of all chains, chain by chain.
    pub control: Vec<Point>,
    pub samples: Vec<Sample>,
    /// The samples of each chain.
    pub chains: Vec<Range<usize>>,
    /// The chain of each sample.
    pub numbers: Vec<u32>,
    controls: Vec<Range<usize>>,
    /// Length of each chain's spans, radii.
    spans: Vec<f64>,
    radius: f64,
}

impl Curves {
    /// Fits curves to smoothed nodes by least squares.
    pub fn through(chains: &[Vec<Point>], radius: f64) -> Self {
        let mut made = Self {
            control: Vec::new(),
            samples: Vec::new(),
            chains: Vec::new(),
            numbers: Vec::new(),
            controls: Vec::new(),
            spans: Vec::new(),
            radius,
        };
        for (number, nodes) in chains.iter().enumerate() {
            let nodes = resampled(&smoothed(nodes, 3), STEP * radius);
            let arc = arc_length(&nodes);
            let length = arc[arc.len() - 1] / radius;
            let spans = ((length / SPAN).ceil() as usize).max(2);
            let start = made.control.len();
            let mut normal = Band::<4>::zeros(spans + 3);
            let mut right = vec![[0.0; 3]; spans + 3];
            let from = made.samples.len();
            for (i, node) in nodes.iter().enumerate() {
                let u = (spans * i) as f64 / (nodes.len() - 1) as f64;
                let span = (u as usize).min(spans - 1);
                let sample = make_sample(start + span, u - span as f64);
                normal.add_square(span, &sample.weights, 1.0);
                for a in 0..4 {
                    right[span + a] = advance(right[span + a], sample.weights[a], *node);
                }
                let end = i.min(nodes.len() - 1 - i) as f64 * STEP;
                made.samples.push(Sample { capped: end < CAP, ..sample });
            }
            for span in 0..spans {
                normal.add_square(span, &THIRD, 1e-4);
            }
            normal.factored(|_| 1e-9).solve(&mut right);
            made.control.extend(right);
            made.chains.push(from..made.samples.len());
            made.numbers.resize(made.samples.len(), number as u32);
            made.controls.push(start..made.control.len());
            made.spans.push((length / spans as f64).max(1e-3));
        }
        made
    }

    /// Returns the sample nearest to a place on a chain.
    pub fn nearest(&self, place: OnChain) -> usize {
        let chain = &self.chains[place.chain];
        chain.start + (place.share * (chain.len() - 1) as f64).round() as usize
    }

    /// Returns the first and the last sample of each chain.
    pub fn ends(&self) -> impl Iterator<Item = usize> + '_ {
        self.chains.iter().flat_map(|chain| [chain.start, chain.end - 1])
    }

    /// Returns the samples in the ends' caps, each with the last sample of its chain before the cap.
    pub fn caps(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.chains.iter().flat_map(|chain| {
            let free = |&i: &usize| !self.samples[i].capped;
            let first = chain.clone().find(free).unwrap_or(chain.start);
            let last = chain.clone().rfind(free).unwrap_or(chain.end - 1);
            (chain.start..first).map(move |i| (i, first)).chain((last + 1..chain.end).map(move |i| (i, last)))
        })
    }

    /// Computes the samples' positions, and unit vectors along the rope.
    pub fn place(&self, positions: &mut Vec<Point>, tangents: &mut Vec<Point>) {
        positions.clear();
        tangents.clear();
        for sample in &self.samples {
            let control = &self.control[sample.first..sample.first + 4];
            let sum = |w: &[f64; 4]| -> Point {
                std::array::from_fn(|k| {
                    w[0] * control[0][k] + w[1] * control[1][k] + w[2] * control[2][k] + w[3] * control[3][k]
                })
            };
            positions.push(sum(&sample.weights));
            tangents.push(normalized(sum(&sample.slopes)));
        }
    }

    /// Adds the weighted costs of bending and of its change to the matrix of the control points' coordinates and to
    /// half its gradient.
    pub fn stiffen(&self, bend: f64, change: f64, matrix: &mut Bordered, gradient: &mut [f64]) {
        for (controls, &span) in self.controls.iter().zip(&self.spans) {
            let second = bend / span.powi(3) / self.radius.powi(2);
            let third = change / span.powi(5) / self.radius.powi(2);
            for first in controls.start..controls.end - 3 {
                for a in 0..4 {
                    for b in 0..4 {
                        let value = second * SECOND[a][b] + third * THIRD[a] * THIRD[b];
                        for k in 0..3 {
                            gradient[3 * (first + a) + k] += value * self.control[first + b][k];
                            if b <= a {
                                matrix.add_band(3 * (first + a) + k, 3 * (first + b) + k, value);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Returns ∫ κ² ds and ∫ (dκ/ds)² ds, with lengths in radii.
    pub fn bending(&self) -> (f64, f64) {
        let (mut bend, mut change) = (0.0, 0.0);
        for (controls, &span) in self.controls.iter().zip(&self.spans) {
            for c in self.control[controls.clone()].windows(4) {
                for k in 0..3 {
                    let third: f64 = (0..4).map(|a| THIRD[a] * c[a][k]).sum();
                    change += third * third / span.powi(5);
                    for a in 0..4 {
                        let row: f64 = (0..4).map(|b| SECOND[a][b] * c[b][k]).sum();
                        bend += c[a][k] * row / span.powi(3);
                    }
                }
            }
        }
        (bend / self.radius.powi(2), change / self.radius.powi(2))
    }

    /// Returns the curves, one for each chain.
    pub fn splines(&self) -> Vec<Spline> {
        self.controls.iter().map(|range| Spline { control: self.control[range.clone()].to_vec() }).collect()
    }
}

/// Makes the sample at t, from 0 to 1, of the span that begins with a control point.
fn make_sample(first: usize, t: f64) -> Sample {
    let s = 1.0 - t;
    Sample {
        first,
        weights: [
            s * s * s / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            t * t * t / 6.0,
        ],
        slopes: [-0.5 * s * s, 0.5 * (3.0 * t * t - 4.0 * t), 0.5 * (4.0 * s - 3.0 * s * s), 0.5 * t * t],
        capped: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn caps_are_followed_from_the_last_sample_before_them() {
        let radius = 0.004;
        let straight = |length: f64| -> Vec<Point> {
            (0..=40).map(|i| [length * radius * f64::from(i) / 40.0, 0.0, radius]).collect()
        };
        let curves = Curves::through(&[straight(20.0), straight(2.0)], radius);
        let caps: Vec<(usize, usize)> = curves.caps().collect();
        let last = curves.chains[0].end - 1;
        // three at each end; none where no sample lies before a cap
        assert_eq!(caps[..3], [(0, 3), (1, 3), (2, 3)]);
        assert_eq!(caps[3..6], [(last - 2, last - 3), (last - 1, last - 3), (last, last - 3)]);
        assert!(caps[6..].is_empty(), "{caps:?}");
    }

    #[test]
    fn a_ring_has_its_places_and_its_bending() {
        let (radius, ring) = (0.004, 0.04);
        let nodes: Vec<Point> = (0..=400)
            .map(|i| f64::from(i) * std::f64::consts::TAU / 400.0)
            .map(|a| [ring * a.cos(), ring * a.sin(), 0.5])
            .collect();
        let curves = Curves::through(&[nodes.clone(), nodes], radius);
        let (mut positions, mut tangents) = (Vec::new(), Vec::new());
        curves.place(&mut positions, &mut tangents);
        assert_eq!(curves.chains.len(), 2);
        let half = curves.chains[0].len();
        assert_eq!(positions[..half], positions[half..]);
        for (p, t) in positions.iter().zip(&tangents) {
            assert!((p[0].hypot(p[1]) - ring).abs() < 2e-5);
            assert!((p[0] * t[0] + p[1] * t[1]).abs() < 2e-2 * ring);
        }
        // 2π R / R², and no change
        let (bend, change) = curves.bending();
        let expected = 2.0 * std::f64::consts::TAU * radius / ring;
        assert!((bend / expected - 1.0).abs() < 0.05, "{bend} for {expected}");
        assert!(change < 0.1 * bend);
        // the matrix gives the same: half the gradient times the control points
        let n = 3 * curves.control.len();
        let mut gradient = vec![0.0; n];
        curves.stiffen(1.0, 1.0, &mut Bordered::zeros(n, 0), &mut gradient);
        let product: f64 = curves.control.as_flattened().iter().zip(&gradient).map(|(x, g)| x * g).sum();
        assert!((product - bend - change).abs() < 1e-6 * bend);
    }
}
