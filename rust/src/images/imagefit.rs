//! Ropes fitted to images: polylines in one view's image become curves in space that agree with the masks and the depth
//! of all views.
//!
//! The noise of depth cameras is wide and correlated. Their masks show where a rope is to a fraction of a pixel, but
//! their depth only to about a radius. So masks come first, and depth decides the rest:
//! - [`lift()`] gives an image's polylines their depth, and decides which strand is on top at crossings.
//! - [`fit`] moves splines, poses and a depth bias for each view until the tubes fill the masks. It also measures what
//!   the fit leaves unexplained.

use crate::clouds::depth::Pinhole;
use crate::geometry::spline::Spline;
use crate::geometry::{Point, RigidMotion, cross, dot, squared_distance, sub};
use crate::images::silhouette::Silhouette;
use curves::Curves;

mod band;
mod cost;
mod crossings;
mod curves;
mod equations;
mod evidence;
mod grid;
mod lift;
mod medians;
mod prepared;
mod rendering;
mod residuals;
mod search;
mod smoothing;
mod support;
#[cfg(test)]
mod tests;

pub use lift::lift;
pub use medians::Medians;
pub use prepared::Prepared;
pub use rendering::DepthScene;
pub use residuals::Scatter;
pub use search::fit;
pub use support::count_support;

const STEP: f64 = 0.5; // distance between samples along the rope, radii
const HIDES: f64 = 1.4; // strands nearer than this in the image hide each other, image radii between axes
/// Strands nearer than this mix their depths, image radii, and pixels in addition: a stereo matcher blurs them.
const MIXES: (f64, f64) = (2.0, 1.5);
const APART: f64 = 4.0; // places of one rope nearer than this along it count as one place, radii
const MIXED: f64 = 0.3; // weight of a depth that is mixed with another strand's
const TOUCHING: f64 = 1.9; // distance between the axes of touching strands, radii: ropes give a little

/// A place in an image: column and row, pixels.
pub type Place2 = [f64; 2];

/// One camera's data.
#[derive(Debug, Clone)]
pub struct RopeView<'a> {
    pub silhouette: &'a Silhouette,
    /// Its depth on the mask.
    pub medians: &'a Medians,
    pub pinhole: Pinhole,
    /// Camera to world.
    pub pose: RigidMotion,
    /// Columns and rows of its image.
    pub size: [usize; 2],
}

impl RopeView<'_> {
    /// Moves a point of the world to the camera frame.
    #[inline]
    fn seen(&self, x: Point) -> Point {
        let d = sub(x, self.pose.translation.into());
        let r = &self.pose.rotation;
        std::array::from_fn(|k| r[(0, k)] * d[0] + r[(1, k)] * d[1] + r[(2, k)] * d[2])
    }

    /// Moves a point of the world to the corrected camera frame.
    #[inline]
    fn corrected(&self, [wx, wy, wz, tx, ty, tz]: &[f64; 6], x: Point) -> Point {
        let y = self.seen(x);
        let turn = cross([*wx, *wy, *wz], y);
        [y[0] + turn[0] + tx, y[1] + turn[1] + ty, y[2] + turn[2] + tz]
    }

    /// Turns a direction of the camera frame to the world frame.
    #[inline]
    fn turned(&self, y: Point) -> Point {
        let r = &self.pose.rotation;
        std::array::from_fn(|k| r[(k, 0)] * y[0] + r[(k, 1)] * y[1] + r[(k, 2)] * y[2])
    }

    /// Projects a point of the camera frame into the image.
    #[inline]
    fn projected(&self, y: Point) -> Place2 {
        self.pinhole.pixel(y)
    }
}

/// Errors of the depth camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Standard deviation of the depth of a disc in the rope's middle, radii; the lift estimates it if None.
    pub noise: Option<f64>,
    /// Correlation length of depth errors along the rope, radii.
    pub correlation: f64,
    /// Standard deviation of the mask's edge, pixels.
    pub lateral: f64,
    /// Distance of the axis behind the depth of such a disc, radii.
    pub surface: f64,
    /// Mean distance by which ropes appear too far away, radii, and a view's standard deviation about it.
    pub bias: [f64; 2],
}

impl Sensor {
    /// A stereo camera near its best distance.
    pub const DEFAULT: Self =
        Self { noise: None, correlation: 3.0, lateral: 0.3, surface: 0.85, bias: [0.0, 0.3] };
}

/// A plane that nothing lies below: its unit normal n, towards the cameras, and n·x on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// n.
    pub normal: Point,
    /// n·x.
    pub offset: f64,
}

impl Plane {
    /// Returns a point's height above it.
    #[inline]
    fn height(&self, x: Point) -> f64 {
        dot(self.normal, x) - self.offset
    }
}

/// A place on a chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnChain {
    /// Number of the chain.
    pub chain: usize,
    /// Its share of the chain's arc length.
    pub share: f64,
}

/// Settings of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageFitOptions {
    /// Gauss–Newton steps at most.
    pub iterations: usize,
    /// The view whose mask gives the ends of the ropes.
    pub reference: usize,
    /// The view whose pose is held; None holds all poses.
    pub held: Option<usize>,
    /// Standard deviations of the poses: rotation in radians, translation in metres.
    pub pose_sd: [f64; 2],
    /// Noise of depth, radii.
    pub noise: f64,
    /// Whether to compute covariances.
    pub uncertainty: bool,
}

/// The part of the data that a hypothesis does not explain. Areas are in squared image radii, lengths in radii.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Misfit {
    /// Area of mask that the tube does not cover.
    pub uncovered: f64,
    /// Area of tube outside the mask.
    pub outside: f64,
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
    /// Gauss–Newton steps taken.
    pub iterations: usize,
}

impl ImageFit {
    /// Replaces the ropes' nodes; each new node gets the covariance of the nearest old one.
    ///
    /// Also returns the pairs of places at crossings, moved to the new ropes, without those that left them. `radius` is
    /// the ropes' radius, metres.
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
