//! A tracked rope: nodes at fixed arc lengths, their motion, and the samples between them.

use crate::geometry::Point;

/// Samples from one node to the next.
pub const SAMPLES: usize = 4;
/// Nodes that a sample depends on.
pub const SUPPORT: usize = 4;
/// Nodes of the shortest rope.
pub const MIN_TRACKED: usize = 6;

/// A gripper that holds a place of the rope.
#[derive(Clone, Copy)]
pub struct Hold {
    /// Place along the rope, in steps between nodes.
    pub at: f64,
    /// Where it is, world frame, metres.
    pub point: Point,
    /// Standard deviation, metres.
    pub sd: f64,
}

/// What is known of a rope at a time. All arrays have one entry for each node.
#[derive(Clone)]
pub struct Rope {
    /// World frame, metres.
    pub nodes: Vec<Point>,
    /// Metres a second.
    pub velocities: Vec<Point>,
    /// Variance of a node in its worst direction, m².
    pub variance: Vec<f64>,
    /// Variance that the last frame's motion added, m².
    pub noise: Vec<f64>,
    /// Where each node was last seen, metres.
    pub last: Vec<Point>,
    /// Seconds since each node was seen.
    pub age: Vec<f64>,
    pub radius: f64,
    /// Arc length from node to node, metres.
    pub spacing: f64,
    /// By how far the tips said in the last frames that the rope slid, towards its last node, metres; None if no tip was
    /// seen.
    pub slid: Option<f64>,
    /// Length of rope that something covers at each end, metres; None at an end that is seen.
    pub covers: [Option<f64>; 2],
    pub holds: Vec<Hold>,
}

/// The weights of a place along the rope.
#[derive(Clone, Copy)]
pub struct Weights {
    /// First of the nodes that it depends on.
    pub start: usize,
    pub value: [f64; SUPPORT],
    /// Of the derivative by steps between nodes.
    pub slope: [f64; SUPPORT],
}

impl Weights {
    /// Returns those of a place `at` in steps between `count` nodes, by Catmull and Rom's spline.
    pub fn new(at: f64, count: usize) -> Self {
        let span = (at.max(0.0) as usize).min(count - 2);
        let x = at - span as f64;
        let (x2, x3) = (x * x, x * x * x);
        let value = [
            0.5 * (-x + 2.0 * x2 - x3),
            0.5 * (2.0 - 5.0 * x2 + 3.0 * x3),
            0.5 * (x + 4.0 * x2 - 3.0 * x3),
            0.5 * (x3 - x2),
        ];
        let slope = [
            0.5 * (-1.0 + 4.0 * x - 3.0 * x2),
            0.5 * (-10.0 * x + 9.0 * x2),
            0.5 * (1.0 + 8.0 * x - 9.0 * x2),
            0.5 * (3.0 * x2 - 2.0 * x),
        ];
        let start = span.saturating_sub(1).min(count - SUPPORT);
        let mut placed = Self { start, value: [0.0; SUPPORT], slope: [0.0; SUPPORT] };
        for (k, (w, d)) in value.into_iter().zip(slope).enumerate() {
            // beyond an end, the rope goes on straight
            let parts = match (span + k).checked_sub(1) {
                None => [(0, 2.0), (1, -1.0)],
                Some(node) if node >= count => [(count - 1, 2.0), (count - 2, -1.0)],
                Some(node) => [(node, 1.0), (node, 0.0)],
            };
            for (node, share) in parts {
                placed.value[node - start] += share * w;
                placed.slope[node - start] += share * d;
            }
        }
        placed
    }

    /// Lists those of all samples of a rope.
    pub fn all(count: usize) -> Vec<Self> {
        (0..=(count - 1) * SAMPLES).map(|i| Self::new(i as f64 / SAMPLES as f64, count)).collect()
    }

    /// Returns the weighted sum of nodes.
    pub fn place(&self, nodes: &[Point]) -> Point {
        combine(&self.value, &nodes[self.start..])
    }

    /// Returns the derivative at the place, metres a step.
    pub fn direction(&self, nodes: &[Point]) -> Point {
        combine(&self.slope, &nodes[self.start..])
    }
}

fn combine(weights: &[f64; SUPPORT], nodes: &[Point]) -> Point {
    let mut sum = [0.0; 3];
    for (w, node) in weights.iter().zip(nodes) {
        for k in 0..3 {
            sum[k] += w * node[k];
        }
    }
    sum
}

impl Rope {
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Returns the speed of the fastest node, m/s.
    pub fn fastest(&self) -> f64 {
        self.velocities.iter().map(|&v| length(v)).fold(0.0, f64::max)
    }
}

pub fn length(a: Point) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}
