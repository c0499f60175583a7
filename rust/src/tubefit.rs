//! Joint fit of tubes and camera poses to surface points.
//!
//! Unknowns are the control points of one spline for each piece of string, a small rigid motion of each view about the
//! pose that was reported, and the ropes' radii. A point's residual is its distance from the tube's surface; so opposite
//! half-shells of a tube, which pull into each other when points are matched with points, are told apart by construction.

use nalgebra::{Matrix3, Matrix6, Rotation3, SymmetricEigen, Vector3};

use crate::error::{Error, Result, check_finite, check_positive};
use crate::geometry::{RigidMotion, advance, centroid, dot, normalized, sub};
use crate::spline::Spline;
use crate::{Point, parallel};

mod equations;
mod feet;
mod search;
mod sums;

use equations::undetermined;
use feet::ViewTerms;

/// Curves longer than this in all would fill the memory with places to compare points with, in radii.
const MOST_RADII: f64 = 1e6;
/// What the prior's standard deviation of a curve's second differences is multiplied with after each step at which it
/// bends too tightly, and where that ends at the latest. It ends where residuals grow by this share: points that bend all
/// the same are followed, and the differences may be so many of the prior's deviations large then, root mean square.
const STIFFENING: f64 = 0.5;
const LEAST_SLACK: f64 = 1e-4;
const STRAINED: f64 = 0.01;
const MOST_STRAIN: f64 = 3.0;
/// Tukey's limit in standard deviations of the noise, for 95 % of the efficiency of least squares on normal noise.
const EFFICIENT: f64 = 4.685;
/// After a step of less than this, in standard deviations of the unknowns, points keep to their curves, and their feet
/// move on from where they were.
const SETTLED: f64 = 2.0;
/// Steps before the limit beyond which residuals do not count follows their scatter.
const CLOSE: usize = 2;
/// The data fix a direction of a pose where its standard deviation is under this share of the reported pose's, as they
/// then say more than the report; in the others the view is held there, this many times as precisely as it was reported,
/// in at most so many more steps.
const FIXED: f64 = std::f64::consts::FRAC_1_SQRT_2;
const HOLD: f64 = 1e4;
/// Most steps to the eigenvectors of a view's covariance, which needs a few.
const EIGEN_STEPS: usize = 1000;
const STEPS_HELD: usize = 6;

/// A string to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Tube {
    /// Its axis.
    pub curve: Spline,
    /// The number of the rope that it is a piece of: pieces of one rope share a radius.
    pub rope: usize,
}

/// What one camera saw.
#[derive(Debug, Clone, Copy)]
pub struct TubeView<'a> {
    /// Surface points in the world frame, as the reported pose places them, metres.
    pub points: &'a [Point],
    /// The camera's centre in the world frame, as reported, metres.
    pub viewpoint: Point,
    /// Where it sees strings end.
    pub ends: &'a [EndSighting],
    /// Where an earlier fit left the points if this one goes on from its curves, None where no tube is near; else empty.
    pub feet: &'a [Option<OnCurve>],
}

/// A place of one of the curves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnCurve {
    /// Number of the curve.
    pub curve: usize,
    /// The curve's parameter there.
    pub parameter: f64,
}

/// Where one camera sees a string end: the only thing that it sees of the way along a straight string.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndSighting {
    /// Which end; sightings of the same end by several views bind these together.
    pub end: usize,
    /// Its place in the world frame, as the reported pose places it, metres.
    pub place: Point,
    /// Unit vector along the string, out of it. Across it the place says nothing.
    pub outward: Point,
    /// Standard deviation of the place in that direction, metres.
    pub sd: f64,
}

/// How a residual is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Residual {
    /// The distance from the axis less the radius: forgiving far from the solution.
    Distance,
    /// The distance between the observed point and where its camera's ray hits the tube, times the cosine of the angle
    /// of incidence: without bias under noise along the ray.
    Ray,
}

/// What is fitted, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeFitOptions {
    /// Whether curves change.
    pub fit_curves: bool,
    /// What is known of each rope's radius beforehand, its mean and standard deviation, metres; None: radii are held.
    pub radius_prior: Option<Vec<[f64; 2]>>,
    /// The view that stays where it is; the others move. None: all stay.
    pub reference: Option<usize>,
    /// Standard deviations of the reported poses: rotation in radians, translation in metres.
    pub pose_sd: [f64; 2],
    /// How residuals are measured.
    pub residual: Residual,
    /// Tukey's limit at the first and the last iteration, in radii.
    pub band: [f64; 2],
    /// Most Gauss–Newton steps.
    pub iterations: usize,
    /// After a step of less than this, in standard deviations of the unknowns, there is no other; after one of less than
    /// 0.1, another changes nothing that the data tell.
    pub tolerance: f64,
    /// The tightest bend of a curve: its radius of curvature, in radii. A curve that bends more tightly is made stiffer,
    /// as far as its points allow.
    pub min_bend: f64,
    /// Standard deviation of the sensor's noise along the viewing rays, metres; None: estimated from the residuals.
    pub noise: Option<f64>,
    /// Extraction range, low and high corner, metres. Noise carries points out of it but none in, so points whose
    /// place on the tube lies within two standard deviations of its faces have no part.
    pub bounds: Option<[Point; 2]>,
    /// Whether to work out how well the unknowns are fixed, and to hold views at the reported poses in directions
    /// that the data leave open.
    pub uncertainty: bool,
}

/// Where a point ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// Number of the curve that explains the point best.
    pub curve: usize,
    /// The parameter of the nearest place of its axis.
    pub parameter: f64,
    /// Distance from the surface, metres; positive outside.
    pub residual: f64,
    /// Outward unit normal at the foot.
    pub outward: Point,
    /// Cosine between that and the direction to the camera.
    pub facing: f64,
    /// Weight in the fit; 0 if it has no part.
    pub weight: f64,
    /// Whether the point is where the tube could have been seen.
    pub explained: bool,
    /// Whether it is explained, and its residual within the last limit beyond which residuals did not count.
    pub inlier: bool,
}

/// The outcome of a joint fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeFit {
    /// The curves.
    pub curves: Vec<Spline>,
    /// For each view, the rigid motion of the world frame that corrects its reported pose.
    pub motions: Vec<RigidMotion>,
    /// The ropes' radii, metres.
    pub radii: Vec<f64>,
    /// Robust standard deviation of the residuals, metres.
    pub sigma: f64,
    /// For each rope, the last limit beyond which residuals did not count, metres.
    pub bands: Vec<f64>,
    /// For each view, where its points ended.
    pub feet: Vec<Vec<Foot>>,
    /// Gauss–Newton steps taken.
    pub iterations: usize,
    /// How well the unknowns are fixed, if that was asked for.
    pub uncertainty: Option<Uncertainty>,
}

/// How well the data and the priors together fix the unknowns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uncertainty {
    /// Covariance of each view's rotation vector, radians, and translation of the points' centroid, metres; 0 for a
    /// view that stays.
    pub poses: Vec<[[f64; 6]; 6]>,
    /// Standard deviations of the ropes' radii, metres; 0 if they were held.
    pub radii: Vec<f64>,
    /// For each curve and control point, its 3x3 covariances with itself and with the next three, m²; empty if the
    /// curves were held.
    pub curves: Vec<Vec<[[Point; 3]; 4]>>,
}

/// State of a fit between iterations.
struct State<'a> {
    views: &'a [TubeView<'a>],
    curves: Vec<Spline>,
    motions: Vec<RigidMotion>,
    /// Rotation vector and translation of each motion, about `center`.
    twists: Vec<[f64; 6]>,
    center: Point,
    /// The rope of each curve, and the ropes' radii now and at the start.
    ropes: Vec<usize>,
    radii: Vec<f64>,
    start_radii: Vec<f64>,
    /// For each curve, what the standard deviation of its second differences' prior is multiplied with.
    slack: Vec<f64>,
    /// For each view, the precision that holds it at the reported pose in open directions.
    held: Vec<[[f64; 6]; 6]>,
    sigma: f64,
    /// The least that it was.
    least_sigma: f64,
    /// Whether stiff curves drew away from their points, so that none is made stiffer any more.
    strained: bool,
    /// Standard deviation of a point whose weight is 1: of its residual, or of the noise along its ray.
    noise: f64,
}

/// Fits curves, poses and radius to the points of all views.
///
/// Gauss–Newton with Tukey's loss whose limit shrinks from `band[0]` to `band[1]`, but not below where it
/// would cost efficiency. Poses have the reported ones as a prior; curves one of small third differences, which
/// matters only where points are few.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, a number is out of range, or a curve has
/// fewer than four control points; [`NotEnoughData`](Error::NotEnoughData) if no point lies near a curve, or the points
/// do not fix the unknowns.
pub fn fit_tubes(
    views: &[TubeView],
    tubes: &[Tube],
    motions: &[RigidMotion],
    radii: &[f64],
    options: &TubeFitOptions,
) -> Result<TubeFit> {
    for &radius in radii {
        check_positive("radius", radius)?;
    }
    for view in views {
        check_finite("points", view.points)?;
        check_finite("viewpoint", &[view.viewpoint])?;
        for sighting in view.ends {
            check_finite("ends", &[sighting.place, sighting.outward])?;
            check_positive("ends", sighting.sd)?;
        }
        let mut numbers: Vec<usize> = view.ends.iter().map(|sighting| sighting.end).collect();
        numbers.sort_unstable();
        if numbers.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(Error::invalid("ends", "a view sees an end once"));
        }
    }
    for foot in views.iter().flat_map(|view| view.feet).flatten() {
        if tubes.get(foot.curve).is_none_or(|tube| !(0.0..=tube.curve.end()).contains(&foot.parameter)) {
            return Err(Error::invalid("feet", "expected parameters of the curves"));
        }
    }
    if views.iter().any(|view| view.feet.len() != if going_on(views) { view.points.len() } else { 0 }) {
        return Err(Error::invalid("feet", "expected one for each point, or none for all views"));
    }
    if tubes.is_empty() || tubes.iter().any(|tube| tube.curve.control.len() < 4) {
        return Err(Error::invalid(
            "curves",
            "expected at least one curve, each with four control points or more",
        ));
    }
    if tubes.iter().any(|tube| tube.rope >= radii.len()) {
        let reason = format!("expected the number of one of {} ropes for each curve", radii.len());
        return Err(Error::invalid("ropes", reason));
    }
    if motions.len() != views.len() {
        return Err(Error::invalid("motions", format!("expected one for each of {} views", views.len())));
    }
    if options.reference.is_some_and(|reference| reference >= views.len()) {
        return Err(Error::invalid(
            "reference",
            format!("expected the number of one of {} views", views.len()),
        ));
    }
    for sd in options.pose_sd {
        check_positive("pose_sd", sd)?;
    }
    if let Some(priors) = &options.radius_prior {
        if priors.len() != radii.len() {
            let reason = format!("expected one for each of {} ropes", radii.len());
            return Err(Error::invalid("radius_prior", reason));
        }
        for value in priors.as_flattened() {
            check_positive("radius_prior", *value)?;
        }
    }
    for band in options.band {
        check_positive("band", band)?;
    }
    check_positive("tolerance", options.tolerance)?;
    check_positive("min_bend", options.min_bend)?;
    if let Some(noise) = options.noise {
        check_positive("noise", noise)?;
    }
    for tube in tubes {
        check_finite("curves", &tube.curve.control)?;
    }
    let spans: f64 = tubes.iter().map(|tube| tube.curve.length() / radii[tube.rope]).sum();
    if spans > MOST_RADII {
        let reason = format!("the curves are {spans:.1e} radii long, more than {MOST_RADII:e}");
        return Err(Error::invalid("radius", reason));
    }
    let all: Vec<Point> = views.iter().map(|view| centroid(view.points)).collect();
    let center = centroid(&all);
    let mut state = State {
        views,
        curves: tubes.iter().map(|tube| tube.curve.clone()).collect(),
        motions: motions.to_vec(),
        twists: motions.iter().map(|motion| twist(motion, center)).collect(),
        center,
        ropes: tubes.iter().map(|tube| tube.rope).collect(),
        radii: radii.to_vec(),
        start_radii: radii.to_vec(),
        slack: vec![1.0; tubes.len()],
        held: vec![[[0.0; 6]; 6]; views.len()],
        sigma: 0.2 * smallest(radii),
        least_sigma: f64::INFINITY,
        strained: false,
        noise: 0.2 * smallest(radii),
    };
    parallel::run(|| state.run(options))
}

/// All views' points where corrected poses place them, and the unit vectors to their cameras.
pub fn placed(views: &[TubeView], motions: &[RigidMotion]) -> (Vec<Point>, Vec<Point>) {
    let (mut points, mut to_camera) = (Vec::new(), Vec::new());
    for (view, motion) in views.iter().zip(motions) {
        let camera = motion.apply(view.viewpoint);
        points.extend(view.points.iter().map(|&p| motion.apply(p)));
        let placed = &points[to_camera.len()..];
        to_camera.extend(placed.iter().map(|&p| normalized(sub(camera, p))));
    }
    (points, to_camera)
}

/// Rotation vector, and translation of a point, of a rigid motion.
fn twist(motion: &RigidMotion, center: Point) -> [f64; 6] {
    let w = Rotation3::from_matrix_unchecked(motion.rotation).scaled_axis();
    let t = sub(motion.apply(center), center);
    [w.x, w.y, w.z, t[0], t[1], t[2]]
}

/// The rigid motion that turns by a rotation vector about a point and then translates.
fn motion_about(step: [f64; 6], center: Point) -> RigidMotion {
    let rotation: Matrix3<f64> = Rotation3::new(Vector3::new(step[0], step[1], step[2])).into_inner();
    let c = Vector3::from(center);
    RigidMotion { rotation, translation: c - rotation * c + Vector3::new(step[3], step[4], step[5]) }
}

impl State<'_> {
    fn run(&mut self, options: &TubeFitOptions) -> Result<TubeFit> {
        // the limit beyond which residuals do not count need not begin wide again
        let mut iteration = if self.goes_on() { CLOSE } else { 0 };
        let mut step = f64::INFINITY;
        let mut terms: Vec<ViewTerms> = Vec::new();
        loop {
            let share = iteration as f64 / options.iterations.saturating_sub(1).max(1) as f64;
            let planned = options.band[0] + (options.band[1] - options.band[0]) * share.min(1.0);
            let bands: Vec<f64> = (self.radii.iter())
                .map(|r| {
                    let least = if iteration > CLOSE { EFFICIENT * self.noise } else { 0.6 * r };
                    (planned * r).max(least).min(1.2 * r)
                })
                .collect();
            let done = iteration == options.iterations;
            let known = (step < SETTLED).then_some(terms);
            terms = self.terms(options, &bands, known);
            self.measure(&terms, options);
            if done {
                return self.result(terms, &bands, iteration, options);
            }
            step = self.step(&terms, options)?;
            iteration += 1;
            if !self.stiffen(options) && iteration > CLOSE + 1 && step < options.tolerance {
                let terms = self.terms(options, &bands, Some(terms));
                return self.result(terms, &bands, iteration, options);
            }
        }
    }

    /// Whether an earlier fit left the points near their feet.
    fn goes_on(&self) -> bool {
        going_on(self.views)
    }

    /// Holds views at the reported poses in directions that the data leave open; says whether there are any.
    ///
    /// What little the data seem to say of such a direction is mostly what curves make of noise: views would wander.
    fn hold(&mut self, uncertainty: &Uncertainty, options: &TubeFitOptions) -> bool {
        let sd: [f64; 6] = std::array::from_fn(|k| options.pose_sd[k / 3]);
        let mut open = false;
        for (held, covariance) in self.held.iter_mut().zip(&uncertainty.poses) {
            let scaled = Matrix6::from_fn(|i, j| covariance[i][j] / (sd[i] * sd[j]));
            // one that does not converge, as of numbers that are not finite, says nothing: the view is not held
            let Some(eigen) = SymmetricEigen::try_new(scaled, f64::EPSILON, EIGEN_STEPS) else { continue };
            for (&variance, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
                if variance > FIXED * FIXED {
                    open = true;
                    for (i, row) in held.iter_mut().enumerate() {
                        for (j, entry) in row.iter_mut().enumerate() {
                            *entry += HOLD * direction[i] * direction[j] / (sd[i] * sd[j]);
                        }
                    }
                }
            }
        }
        open
    }

    /// The radius of a curve.
    fn radius(&self, curve: usize) -> f64 {
        self.radii[self.ropes[curve]]
    }

    fn result(
        &mut self,
        mut terms: Vec<ViewTerms>,
        bands: &[f64],
        mut iterations: usize,
        options: &TubeFitOptions,
    ) -> Result<TubeFit> {
        let uncertainty = options.uncertainty.then(|| self.uncertainty(&terms, options)).transpose()?;
        if uncertainty.as_ref().is_some_and(|uncertainty| self.hold(uncertainty, options)) {
            for _ in 0..STEPS_HELD {
                let step = self.step(&terms, options)?;
                terms = self.terms(options, bands, Some(terms));
                iterations += 1;
                if step < options.tolerance {
                    break;
                }
            }
        }
        Ok(TubeFit {
            uncertainty,
            curves: self.curves.clone(),
            motions: self.motions.clone(),
            radii: self.radii.clone(),
            sigma: self.sigma,
            bands: bands.to_vec(),
            feet: self.feet(&terms),
            iterations,
        })
    }

    /// Updates the standard deviations of residuals and of noise.
    fn measure(&mut self, terms: &[ViewTerms], options: &TubeFitOptions) {
        let mut sizes = Vec::new();
        let mut along_rays = Vec::new();
        for (curve, near) in terms.iter().flat_map(ViewTerms::on_curves).filter(|(_, near)| near.inlier) {
            let size = self.radius(curve) as f32 * near.residual.abs();
            sizes.push(size);
            if options.residual == Residual::Ray && options.noise.is_none() {
                along_rays.push(size / near.facing.max(0.4));
            }
        }
        if sizes.len() > 50 {
            let least = 0.02 * smallest(&self.radii);
            self.sigma = robust_sd(sizes).max(least);
            self.least_sigma = self.least_sigma.min(self.sigma);
            self.noise = match (options.residual, options.noise) {
                (Residual::Distance, _) => self.sigma,
                (Residual::Ray, Some(noise)) => noise,
                (Residual::Ray, None) => robust_sd(along_rays).max(least),
            };
        }
    }

    /// One Gauss–Newton step. Returns its root mean square over the unknowns, or a radius' part if that is larger, in
    /// standard deviations.
    fn step(&mut self, terms: &[ViewTerms], options: &TubeFitOptions) -> Result<f64> {
        let layout = self.layout(options);
        if layout.banded + layout.border() == 0 {
            return Ok(0.0);
        }
        let (matrix, right_band, right_border) = self.assemble(terms, &layout, options)?;
        let factor = matrix.factor().ok_or_else(undetermined)?;
        let (controls, edges) = factor.solve(&right_band, &right_border);
        let gained: f64 =
            right_band.iter().zip(&controls).chain(right_border.iter().zip(&edges)).map(|(a, b)| a * b).sum();
        if options.fit_curves {
            for (number, (curve, &offset)) in self.curves.iter_mut().zip(&layout.offsets).enumerate() {
                let r = self.radii[self.ropes[number]];
                for (i, control) in curve.control.iter_mut().enumerate() {
                    let step: Point = std::array::from_fn(|k| controls[offset + 3 * i + k]);
                    let size = dot(step, step).sqrt();
                    *control = advance(*control, (0.5 * r / size.max(f64::MIN_POSITIVE)).min(1.0), step);
                }
            }
        }
        for view in 0..self.views.len() {
            if let Some(column) = layout.column(view) {
                let step: [f64; 6] = std::array::from_fn(|k| edges[column + k]);
                self.motions[view] = motion_about(step, self.center).after(&self.motions[view]);
                self.twists[view] = twist(&self.motions[view], self.center);
            }
        }
        let mut size = (gained / (controls.len() + edges.len()) as f64).sqrt();
        for rope in 0..layout.radii {
            let column = layout.poses + rope;
            let variance = factor.border_inverse(column)[column];
            // one unknown among many, and all the others follow it
            size = size.max(edges[column].abs() / variance.sqrt());
            let (r, start) = (self.radii[rope], self.start_radii[rope]);
            let step = edges[column].clamp(-0.15 * r, 0.15 * r);
            self.radii[rope] = (r + step).clamp(0.5 * start, 2.0 * start);
        }
        Ok(size)
    }

    /// Stiffens curves where they bend too tightly; says whether one does.
    fn stiffen(&mut self, options: &TubeFitOptions) -> bool {
        if !options.fit_curves || self.strained {
            return false;
        }
        self.strained = self.sigma > (1.0 + STRAINED) * self.least_sigma;
        let mut tight = false;
        for (i, curve) in self.curves.iter().enumerate() {
            let r = self.radii[self.ropes[i]];
            let square_of_bend = |three: &[Point]| {
                let bend: Point = std::array::from_fn(|k| three[0][k] - 2.0 * three[1][k] + three[2][k]);
                dot(bend, bend)
            };
            let bends_too_tightly = |three: &[Point]| {
                let speed = sub(three[2], three[0]).map(|x| 0.5 * x);
                square_of_bend(three).sqrt() * options.min_bend * r > dot(speed, speed)
            };
            let threes = curve.control.windows(3);
            if self.strained {
                let mean = threes.clone().map(square_of_bend).sum::<f64>() / (3 * threes.len()) as f64;
                let follows = mean.sqrt() / (MOST_STRAIN * equations::SECOND_DIFFERENCE * r);
                self.slack[i] = self.slack[i].max(follows).min(1.0);
            } else if self.slack[i] > LEAST_SLACK && threes.clone().any(bends_too_tightly) {
                self.slack[i] *= STIFFENING;
                tight = true;
            }
        }
        tight
    }
}

/// Whether the feet of all points are those of an earlier fit.
fn going_on(views: &[TubeView]) -> bool {
    views.iter().any(|view| !view.feet.is_empty())
}

fn smallest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Standard deviation of values about zero, from the median of their sizes.
fn robust_sd(mut sizes: Vec<f32>) -> f64 {
    let middle = sizes.len() / 2;
    1.4826 * f64::from(*sizes.select_nth_unstable_by(middle, f32::total_cmp).1)
}
