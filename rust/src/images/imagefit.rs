//! Ropes fitted to images: from polylines in one view's image to curves in space that agree with the masks and the depth
//! of all views.
//!
//! A depth camera with wide, correlated noise says where a rope is across the viewing rays to a fraction of a pixel, by its
//! mask, and along the rays only to about a radius. So the mask leads and depth decides what is left: [`lift`] gives a
//! polyline of an image its depth and decides what lies on top at crossings, [`fit`] moves splines, poses and a bias of
//! each view's depth until the tube fills the masks, and says what it leaves unexplained.

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
pub use support::seen_nodes;

/// Distance between samples along the rope, radii.
const STEP: f64 = 0.5;
/// Strands whose axes are nearer than this in the image hide each other, radii.
const HIDES: f64 = 1.4;
/// Nearer than this, their depths are mixed by the matcher, radii; and as many pixels more.
const MIXES: (f64, f64) = (2.0, 1.5);
/// Places of one rope nearer along it than this are one place, radii.
const APART: f64 = 4.0;
/// Weight of a depth that another strand is mixed into.
const MIXED: f64 = 0.3;
/// How far the axes of touching strands are apart, radii: ropes give a little.
const TOUCHING: f64 = 1.9;

/// A place in an image: column and row, pixels.
pub type Place2 = [f64; 2];

/// What one camera saw of the ropes.
#[derive(Debug, Clone)]
pub struct RopeView<'a> {
    /// Its mask.
    pub silhouette: &'a Silhouette,
    /// Its depth on the mask.
    pub medians: &'a Medians,
    /// Its intrinsics.
    pub pinhole: Pinhole,
    /// Where it stood: camera to world.
    pub pose: RigidMotion,
    /// Columns and rows of its image.
    pub size: [usize; 2],
}

impl RopeView<'_> {
    /// A point of the world in the camera frame.
    #[inline]
    fn seen(&self, x: Point) -> Point {
        let d = sub(x, self.pose.translation.into());
        let r = &self.pose.rotation;
        std::array::from_fn(|k| r[(0, k)] * d[0] + r[(1, k)] * d[1] + r[(2, k)] * d[2])
    }

    /// A point of the world in the camera frame, which a correction turns and moves.
    #[inline]
    fn corrected(&self, [wx, wy, wz, tx, ty, tz]: &[f64; 6], x: Point) -> Point {
        let y = self.seen(x);
        let turn = cross([*wx, *wy, *wz], y);
        [y[0] + turn[0] + tx, y[1] + turn[1] + ty, y[2] + turn[2] + tz]
    }

    /// A direction of the camera frame in the world frame.
    #[inline]
    fn turned(&self, y: Point) -> Point {
        let r = &self.pose.rotation;
        std::array::from_fn(|k| r[(k, 0)] * y[0] + r[(k, 1)] * y[1] + r[(k, 2)] * y[2])
    }

    /// Where the image shows a point of the camera frame.
    #[inline]
    fn projected(&self, y: Point) -> Place2 {
        self.pinhole.pixel(y)
    }
}

/// What is known of the depth camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Standard deviation of the depth that a disc of the rope's middle shows, radii; estimated by the lift if not given.
    pub noise: Option<f64>,
    /// How far along the rope errors of depth are alike, radii.
    pub correlation: f64,
    /// Standard deviation of the place of the mask's edge, pixels.
    pub lateral: f64,
    /// How far the axis lies behind what a disc of the rope's middle shows, radii.
    pub surface: f64,
    /// How much too far away ropes are seen, radii, and the standard deviation of a view's bias about that.
    pub bias: [f64; 2],
}

impl Sensor {
    /// A stereo camera near its best distance.
    pub const DEFAULT: Self =
        Self { noise: None, correlation: 3.0, lateral: 0.3, surface: 0.85, bias: [0.0, 0.3] };
}

/// A plane that nothing goes below: its unit normal n, towards the cameras, and n·x on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// n.
    pub normal: Point,
    /// n·x.
    pub offset: f64,
}

impl Plane {
    /// How far a point is above.
    #[inline]
    fn height(&self, x: Point) -> f64 {
        dot(self.normal, x) - self.offset
    }
}

/// A place of a chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnChain {
    /// Number of the chain.
    pub chain: usize,
    /// Its arc length, as a part of the whole.
    pub share: f64,
}

/// How a fit goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageFitOptions {
    /// Most Gauss–Newton steps.
    pub iterations: usize,
    /// The view whose mask says where the ropes end.
    pub reference: usize,
    /// The view whose pose is held; None: all are.
    pub held: Option<usize>,
    /// Standard deviations of the poses: rotation in radians, translation in metres.
    pub pose_sd: [f64; 2],
    /// Noise of depth, radii.
    pub noise: f64,
    /// Whether to work out how well the curves are known.
    pub uncertainty: bool,
}

/// What a hypothesis leaves unexplained. Areas are in radius_px², a radius in the image squared, twice, lengths in radii.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Misfit {
    /// Mask that the tube does not cover.
    pub uncovered: f64,
    /// Tube outside the mask.
    pub outside: f64,
    /// Squares of depth's residuals over its noise, limited.
    pub depth: f64,
    /// How many independent depths these are.
    pub depths: f64,
    /// ∫ κ² ds.
    pub bend: f64,
    /// ∫ (dκ/ds)² ds.
    pub change: f64,
}

/// The outcome of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFit {
    /// The ropes' axes.
    pub curves: Vec<Spline>,
    /// Their nodes, half a radius apart.
    pub nodes: Vec<Vec<Point>>,
    /// For each node its covariance, m²; empty if that was not asked for.
    pub covariances: Vec<Vec<[Point; 3]>>,
    /// For each view, a rotation vector and a translation that correct its camera frame.
    pub corrections: Vec<[f64; 6]>,
    /// For each view, how much too far it sees the rope, radii, with its sign turned.
    pub biases: Vec<f64>,
    /// Errors of depth about the curves; none if too few are seen.
    pub depth: Option<Scatter>,
    /// Standard deviation of the mask's edge about the tube's outline, pixels; none if too little is seen.
    pub lateral: Option<f64>,
    /// What is left unexplained.
    pub misfit: Misfit,
    /// Gauss–Newton steps taken.
    pub iterations: usize,
}

impl ImageFit {
    /// The same of ropes through other nodes, with covariances of the nearest of its own; and the pairs of places where they
    /// are then, without those that are no longer on the ropes. The radius is that of the ropes, metres.
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
