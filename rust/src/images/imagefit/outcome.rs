//! The result of a fit, and the part of the data that it does not explain.

use super::curves::Curves;
use super::places::OnChain;
use super::residuals::Scatter;
use crate::geometry::spline::Spline;
use crate::geometry::{Point, squared_distance};

/// The part of the data that a hypothesis does not explain. Areas are in squared image radii, lengths in radii.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Misfit {
    /// Area of mask that the tube does not cover.
    pub uncovered: f64,
    /// Area of the tube's middle outside the mask.
    pub outside: f64,
    /// Area of the tube's sides that spills over the mask's edge.
    pub spilled: f64,
    /// Sum of squared depth residuals over the noise, each limited.
    pub depth: f64,
    /// Number of independent depths in that sum.
    pub depths: f64,
    /// ∫ κ² ds.
    pub bend: f64,
    /// ∫ (dκ/ds)² ds.
    pub change: f64,
}

/// The result of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFit {
    /// The ropes' axes.
    pub curves: Vec<Spline>,
    /// Their nodes, half a radius apart.
    pub nodes: Vec<Vec<Point>>,
    /// Covariance of each node, m²; empty if the caller did not ask for it.
    pub covariances: Vec<Vec<[Point; 3]>>,
    /// For each view, a rotation vector and a translation that correct its camera frame.
    pub corrections: Vec<[f64; 6]>,
    /// For each view, minus the distance by which it sees ropes too far away, radii.
    pub biases: Vec<f64>,
    /// Depth errors about the curves; None if there are too few.
    pub depth: Option<Scatter>,
    /// Standard deviation of the mask's edge about the tube's outline, pixels; None if there is too little edge.
    pub lateral: Option<f64>,
    /// The rest that the fit does not explain.
    pub misfit: Misfit,
    /// For each view, its areas: uncovered, outside and spilled, squared image radii.
    pub areas: Vec<[f64; 3]>,
    /// Gauss–Newton steps taken.
    pub iterations: usize,
}

impl ImageFit {
    /// Returns the fit of some of `count` views as one of all: the other views have no corrections and no areas.
    pub fn among(mut self, some: &[usize], count: usize) -> Self {
        let (mut corrections, mut biases) = (vec![[0.0; 6]; count], vec![0.0; count]);
        let mut areas = vec![[0.0; 3]; count];
        for (own, &view) in some.iter().enumerate() {
            corrections[view] = self.corrections[own];
            biases[view] = self.biases[own];
            areas[view] = self.areas[own];
        }
        (self.corrections, self.biases, self.areas) = (corrections, biases, areas);
        self
    }

    /// Returns the fit with new nodes; each gets the covariance of the nearest old node.
    ///
    /// Also returns the pairs of places at crossings, moved to the new nodes. A pair is dropped if a place has no
    /// new node within `radius`, the ropes' radius in metres.
    pub fn through(
        &self,
        nodes: &[Vec<Point>],
        pairs: &[Vec<[OnChain; 2]>],
        radius: f64,
    ) -> (Self, Vec<Vec<[OnChain; 2]>>) {
        let curves = Curves::through(nodes, radius);
        let (mut positions, mut tangents) = (Vec::new(), Vec::new());
        curves.place(&mut positions, &mut tangents);
        let nodes: Vec<Vec<Point>> =
            curves.chains.iter().map(|chain| positions[chain.clone()].to_vec()).collect();
        let nearest = |x: Point, among: &[Point]| {
            let away = |i: &usize| squared_distance(x, among[*i]);
            (0..among.len()).min_by(|i, j| away(i).total_cmp(&away(j))).unwrap_or(0)
        };
        let covariances = self
            .covariances
            .iter()
            .zip(&self.nodes)
            .zip(&nodes)
            .map(|((known, before), now)| now.iter().map(|&x| known[nearest(x, before)]).collect())
            .collect();
        let moved = |on: OnChain| {
            let (before, now) = (&self.nodes[on.chain], &nodes[on.chain]);
            let place = before[(on.share * (before.len() - 1) as f64).round() as usize];
            let i = nearest(place, now);
            let still = squared_distance(place, now[i]) < radius * radius;
            still.then_some(OnChain { share: i as f64 / (now.len() - 1) as f64, ..on })
        };
        let both = |&[upper, lower]: &[OnChain; 2]| Some([moved(upper)?, moved(lower)?]);
        let pairs = pairs.iter().map(|pairs| pairs.iter().filter_map(both).collect()).collect();
        (Self { curves: curves.splines(), nodes, covariances, ..self.clone() }, pairs)
    }
}
