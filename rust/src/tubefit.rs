//! Joint fit of tubes and camera poses to surface points.
//!
//! Unknowns are the control points of one spline for each piece of string, a small rigid motion of each view about the
//! pose that was reported, and the ropes' radii. A point's residual is its distance from the tube's surface; so opposite
//! half-shells of a tube, which pull into each other when points are matched with points, are told apart by construction.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix6, Rotation3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use crate::banded::{Bordered, WIDTH};
use crate::error::{Error, Result, check_finite, check_positive};
use crate::geometry::{RigidMotion, advance, centroid, cross, dot, normalized, sub};
use crate::index::Grid;
use crate::spline::{Pieces, Spline};
use crate::{Point, parallel};

/// Points whose terms are computed by one task; fixed, so that results do not depend on the number of threads.
const POINTS_PER_TASK: usize = 512;
/// Distance between the places of a curve that points are compared with first, in radii.
const SAMPLING: f64 = 0.5;
/// Curves longer than this in all would fill the memory with places to compare points with, in radii.
const MOST_RADII: f64 = 1e6;
/// How far a point may be from an axis to belong to it, in radii.
const REACH: f64 = 2.0;
/// Standard deviations of the prior on a curve: third and second differences of control points, and the way a
/// control point may slide along the curve, in radii. The first is for spans of 1.5 radii: third differences of one
/// and the same curve grow with the cube of the spans.
const THIRD_DIFFERENCE: f64 = 0.1;
const SECOND_DIFFERENCE: f64 = 6.0;
const SLIDE: f64 = 0.05;
/// What the prior's standard deviation of a curve's second differences is multiplied with after each step at which it
/// bends too tightly, and where that ends: points that bend all the same are followed.
const STIFFENING: f64 = 0.5;
const LEAST_SLACK: f64 = 1e-4;
/// Tukey's limit in standard deviations of the noise, for 95 % of the efficiency of least squares on normal noise.
const EFFICIENT: f64 = 4.685;
/// After a step of less than this, in standard deviations of the unknowns, points keep to their curves, and their feet
/// move on from where they were.
const SETTLED: f64 = 2.0;
/// After a step of less than this, in standard deviations of the unknowns, another changes nothing that the data tell.
const TOLERANCE: f64 = 0.1;
/// The data fix a direction of a pose where its standard deviation is under this share of the reported pose's, as they
/// then say more than the report; in the others the view is held there, this many times as precisely as it was reported,
/// in at most so many more steps.
const FIXED: f64 = std::f64::consts::FRAC_1_SQRT_2;
const HOLD: f64 = 1e4;
const STEPS_HELD: usize = 6;
/// How far to both sides a curve's direction is taken where poses are concerned, in spans.
const STRETCH: f64 = 2.0;
/// At how many places of a span it is taken.
const DIRECTIONS: f64 = 8.0;

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

/// The foot of a point that no tube is near to.
const NOWHERE: Foot = Foot {
    curve: 0,
    parameter: 0.0,
    residual: f64::INFINITY,
    outward: [0.0; 3],
    facing: 0.0,
    weight: 0.0,
    explained: false,
    inlier: false,
};

impl Foot {
    /// Where it is, if it is anywhere.
    fn place(&self) -> Option<OnCurve> {
        (self.residual < f64::INFINITY).then_some(OnCurve { curve: self.curve, parameter: self.parameter })
    }
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
    /// Standard deviation of a point whose weight is 1: of its residual, or of the noise along its ray.
    noise: f64,
}

/// A place of a curve that points are compared with.
#[derive(Clone, Copy)]
struct Sample {
    position: Point,
    tangent: Point,
    radius: f64,
    place: OnCurve,
}

/// A place of one of the curves.
#[derive(Clone, Copy)]
struct OnCurve {
    curve: usize,
    parameter: f64,
}

/// Places along all curves, to find the one that explains a point best.
struct Search {
    grid: Grid,
    /// In the grid's order.
    samples: Vec<Sample>,
    /// Points that turn farther away from their cameras, as a cosine, lie on the far side of a tube.
    least_facing: f64,
}

/// One point's part in the normal equations.
#[derive(Clone, Copy)]
struct Term {
    moved: Point,
    /// The outward normal as far as poses are concerned: at a right angle to the curve's direction, see [`directions`].
    settled: Point,
    foot: Foot,
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
        noise: 0.2 * smallest(radii),
    };
    parallel::run(|| state.run(options))
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
        let mut iteration = 0;
        let mut step = f64::INFINITY;
        let mut terms = Vec::new();
        loop {
            let share = iteration as f64 / options.iterations.saturating_sub(1).max(1) as f64;
            let planned = options.band[0] + (options.band[1] - options.band[0]) * share.min(1.0);
            let bands: Vec<f64> = (self.radii.iter())
                .map(|r| {
                    let least = if iteration > 2 { EFFICIENT * self.noise } else { 0.6 * r };
                    (planned * r).max(least).min(1.2 * r)
                })
                .collect();
            let done = iteration == options.iterations;
            let known = (step < SETTLED).then_some(terms);
            terms = self.terms(options, &bands, known.as_deref());
            self.measure(&terms, options);
            if done {
                return self.result(terms, &bands, iteration, options);
            }
            step = self.step(&terms, options)?;
            iteration += 1;
            if !self.stiffen(options) && iteration > 4 && step < TOLERANCE {
                let terms = self.terms(options, &bands, Some(&terms));
                return self.result(terms, &bands, iteration, options);
            }
        }
    }

    /// Holds views at the reported poses in directions that the data leave open; says whether there are any.
    ///
    /// What little the data seem to say of such a direction is mostly what curves make of noise: views would wander.
    fn hold(&mut self, uncertainty: &Uncertainty, options: &TubeFitOptions) -> bool {
        let sd: [f64; 6] = std::array::from_fn(|k| options.pose_sd[k / 3]);
        let mut open = false;
        for (held, covariance) in self.held.iter_mut().zip(&uncertainty.poses) {
            let scaled = Matrix6::from_fn(|i, j| covariance[i][j] / (sd[i] * sd[j]));
            let eigen = SymmetricEigen::new(scaled);
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
        mut terms: Vec<Vec<Term>>,
        bands: &[f64],
        mut iterations: usize,
        options: &TubeFitOptions,
    ) -> Result<TubeFit> {
        let uncertainty = options.uncertainty.then(|| self.uncertainty(&terms, options)).transpose()?;
        if uncertainty.as_ref().is_some_and(|uncertainty| self.hold(uncertainty, options)) {
            for _ in 0..STEPS_HELD {
                let step = self.step(&terms, options)?;
                terms = self.terms(options, bands, Some(&terms));
                iterations += 1;
                if step < TOLERANCE {
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
            feet: terms.into_iter().map(|view| view.into_iter().map(|term| term.foot).collect()).collect(),
            iterations,
        })
    }

    /// The feet of all points at the current curves, poses and radius; on the curves that they are known to be on.
    fn terms(&self, options: &TubeFitOptions, bands: &[f64], known: Option<&[Vec<Term>]>) -> Vec<Vec<Term>> {
        let search = known.is_none().then(|| Search::new(self, options.residual));
        let directions: Vec<Vec<Point>> = self.curves.iter().map(directions).collect();
        let pieces: Vec<Pieces> = self.curves.iter().map(Spline::pieces).collect();
        let in_view = |view: usize| {
            let motion = &self.motions[view];
            let camera = motion.apply(self.views[view].viewpoint);
            let points = self.views[view].points;
            let term = |i: usize| {
                let moved = motion.apply(points[i]);
                let to_camera = normalized(sub(camera, moved));
                let start = match (&search, known) {
                    (Some(search), _) => search.place(moved, to_camera),
                    (None, known) => known.and_then(|known| known[view][i].foot.place()),
                };
                let Some(start) = start else {
                    return Term { moved, settled: [0.0; 3], foot: NOWHERE };
                };
                let mut foot =
                    self.foot(moved, to_camera, start, &pieces[start.curve], options.residual, bands);
                if options.bounds.is_some_and(|bounds| self.is_cut(&foot, bounds)) {
                    foot.weight = 0.0;
                }
                let along = directions[foot.curve][(foot.parameter * DIRECTIONS).round() as usize];
                let settled = normalized(advance(foot.outward, -dot(foot.outward, along), along));
                Term { moved, settled, foot }
            };
            (0..points.len()).into_par_iter().with_min_len(POINTS_PER_TASK).map(term).collect()
        };
        (0..self.views.len()).into_par_iter().map(in_view).collect()
    }

    /// Whether noise may have carried points out of the extraction range at a foot.
    fn is_cut(&self, foot: &Foot, [low, high]: [Point; 2]) -> bool {
        let axis = self.curves[foot.curve].at(foot.parameter).position;
        let surface = advance(axis, self.radius(foot.curve), foot.outward);
        let margin = 2.0 * self.sigma;
        (0..3).any(|k| surface[k] < low[k] + margin || surface[k] > high[k] - margin)
    }

    /// A point's foot near a place.
    fn foot(
        &self,
        p: Point,
        to_camera: Point,
        start: OnCurve,
        curve: &Pieces,
        residual: Residual,
        bands: &[f64],
    ) -> Foot {
        let r = self.radius(start.curve);
        let band = bands[self.ropes[start.curve]];
        let mut parameter = start.parameter;
        for _ in 0..2 {
            let place = curve.at(parameter);
            let x = sub(p, place.position);
            let square = dot(place.first, place.first);
            let slope = (square - dot(x, place.second)).max(0.3 * square);
            parameter = (parameter + dot(x, place.first) / slope).clamp(0.0, curve.end());
        }
        let place = curve.at(parameter);
        let tangent = normalized(place.first);
        let beyond = dot(sub(p, place.position), tangent);
        let q = advance(sub(p, place.position), -beyond, tangent);
        let d = dot(q, q).sqrt().max(f64::MIN_POSITIVE);
        let foot = Foot { curve: start.curve, parameter, ..NOWHERE };
        if beyond.abs() > 0.02 * r {
            return Foot { residual: d - r, ..foot };
        }
        match residual {
            Residual::Distance => {
                let outward = q.map(|x| x / d);
                let facing = dot(outward, to_camera);
                let explained = facing > 0.1;
                let weight = if explained { tukey(d - r, band) } else { 0.0 };
                let inlier = explained && (d - r).abs() < band;
                Foot { residual: d - r, outward, facing, explained, inlier, weight, ..foot }
            }
            Residual::Ray => along_ray(foot, q, to_camera, tangent, r, band),
        }
    }

    /// Updates the standard deviations of residuals and of noise.
    fn measure(&mut self, terms: &[Vec<Term>], options: &TubeFitOptions) {
        let used: Vec<&Foot> =
            terms.iter().flatten().map(|term| &term.foot).filter(|foot| foot.inlier).collect();
        if used.len() > 50 {
            let least = 0.02 * smallest(&self.radii);
            self.sigma = robust_sd(used.iter().map(|foot| foot.residual)).max(least);
            self.noise = match (options.residual, options.noise) {
                (Residual::Distance, _) => self.sigma,
                (Residual::Ray, Some(noise)) => noise,
                (Residual::Ray, None) => {
                    robust_sd(used.iter().map(|foot| foot.residual / foot.facing.max(0.4))).max(least)
                }
            };
        }
    }

    /// How the unknowns are laid out.
    fn layout(&self, options: &TubeFitOptions) -> Layout {
        let mut offsets = Vec::new();
        let mut banded = 0;
        for curve in &self.curves {
            offsets.push(banded);
            banded += 3 * curve.control.len();
        }
        let poses = if options.reference.is_some() { 6 * (self.views.len() - 1) } else { 0 };
        Layout {
            offsets,
            banded: if options.fit_curves { banded } else { 0 },
            poses,
            radii: if options.radius_prior.is_some() { self.radii.len() } else { 0 },
            reference: options.reference,
        }
    }

    /// The normal equations at the given feet: the matrix, and the right-hand sides of its band and its border.
    fn assemble(
        &self,
        terms: &[Vec<Term>],
        layout: &Layout,
        options: &TubeFitOptions,
    ) -> Result<(Bordered, Vec<f64>, Vec<f64>)> {
        let mut matrix = Bordered::zeros(layout.banded, layout.border());
        let mut right_band = vec![0.0; layout.banded];
        let mut right_border = vec![0.0; layout.border()];
        let of_views: Vec<ViewSums> = (0..self.views.len())
            .into_par_iter()
            .map(|view| self.view_sums(&terms[view], layout.column(view).is_some(), layout))
            .collect();
        let mut used = 0;
        for (view, sums) in of_views.iter().enumerate() {
            used += sums.used;
            matrix.add_band_rows(&sums.band);
            for (x, y) in right_band.iter_mut().zip(&sums.right_band) {
                *x += y;
            }
            for (rope, (corner, right_edge)) in sums.corner.iter().zip(&sums.right_edge).enumerate() {
                let poses =
                    layout.column(view).into_iter().flat_map(|column| (0..6).map(move |k| (k, column + k)));
                let radius = (layout.radii > 0).then_some((6, layout.poses + rope));
                let edges: Vec<(usize, usize)> = poses.chain(radius).collect();
                for (i, &(from, to)) in edges.iter().enumerate() {
                    right_border[to] += right_edge[from];
                    for &(other, column) in &edges[..=i] {
                        matrix.add_corner(to, column, corner[from][other]);
                    }
                }
            }
            for (curve, &offset) in layout.offsets.iter().enumerate().filter(|_| layout.banded > 0) {
                let poses =
                    layout.column(view).into_iter().flat_map(|column| (0..6).map(move |k| (k, column + k)));
                let radius = (layout.radii > 0).then_some((6, layout.poses + self.ropes[curve]));
                let rows = offset..offset + 3 * self.curves[curve].control.len();
                for (from, to) in poses.chain(radius) {
                    for row in rows.clone() {
                        matrix.add_border(row, to, sums.border[row][from]);
                    }
                }
            }
        }
        if used < 10 {
            return Err(Error::not_enough("points", format!("only {used} of them lie on a tube")));
        }
        if options.fit_curves {
            for (i, (curve, &offset)) in self.curves.iter().zip(&layout.offsets).enumerate() {
                smoothness(curve, offset, self.radius(i), self.slack[i], &mut matrix, &mut right_band);
            }
        }
        for (rope, [mean, sd]) in options.radius_prior.iter().flatten().enumerate() {
            let column = layout.poses + rope;
            matrix.add_corner(column, column, sd.powi(-2));
            right_border[column] -= (self.radii[rope] - mean) / (sd * sd);
        }
        self.add_ends(layout, &mut matrix, &mut right_border);
        let precision: [f64; 6] = std::array::from_fn(|k| options.pose_sd[k / 3].powi(-2));
        for (view, twist) in self.twists.iter().enumerate() {
            if let Some(column) = layout.column(view) {
                for k in 0..6 {
                    matrix.add_corner(column + k, column + k, precision[k]);
                    right_border[column + k] -= precision[k] * twist[k];
                    for (l, entry) in self.held[view][k].iter().enumerate() {
                        right_border[column + k] -= entry * twist[l];
                        if l <= k {
                            matrix.add_corner(column + k, column + l, *entry);
                        }
                    }
                }
            }
        }
        Ok((matrix, right_band, right_border))
    }

    /// Adds the sightings of ends: each end has one place along its string, an unknown that is eliminated here.
    fn add_ends(&self, layout: &Layout, matrix: &mut Bordered, right: &mut [f64]) {
        let mut ends: BTreeMap<usize, Vec<(usize, &EndSighting)>> = BTreeMap::new();
        for (view, seen) in self.views.iter().enumerate() {
            for sighting in seen.ends {
                ends.entry(sighting.end).or_default().push((view, sighting));
            }
        }
        for sightings in ends.values() {
            let rows: Vec<(Option<usize>, [f64; 6], f64, f64)> = sightings
                .iter()
                .map(|&(view, sighting)| {
                    let moved = self.motions[view].apply(sighting.place);
                    let arm = sub(moved, self.center);
                    let (turn, along) = (cross(arm, sighting.outward), dot(arm, sighting.outward));
                    let jacobian =
                        std::array::from_fn(|k| if k < 3 { turn[k] } else { sighting.outward[k - 3] });
                    (layout.column(view), jacobian, along, sighting.sd.powi(-2))
                })
                .collect();
            let total: f64 = rows.iter().map(|&(.., weight)| weight).sum();
            let mean = rows.iter().map(|&(.., along, weight)| weight * along).sum::<f64>() / total;
            for (i, &(column, x, along, weight)) in rows.iter().enumerate() {
                let Some(column) = column else { continue };
                for a in 0..6 {
                    right[column + a] -= weight * x[a] * (along - mean);
                    for b in 0..=a {
                        matrix.add_corner(
                            column + a,
                            column + b,
                            weight * (1.0 - weight / total) * x[a] * x[b],
                        );
                    }
                }
                for &(other, y, _, other_weight) in &rows[..i] {
                    let Some(other) = other else { continue };
                    for (a, x) in x.iter().enumerate() {
                        for (b, y) in y.iter().enumerate() {
                            matrix.add_corner(column + a, other + b, -weight * other_weight / total * x * y);
                        }
                    }
                }
            }
        }
    }

    /// One view's part of the normal equations.
    fn view_sums(&self, terms: &[Term], moves: bool, layout: &Layout) -> ViewSums {
        let mut sums = ViewSums {
            used: 0,
            band: vec![[0.0; WIDTH]; layout.banded],
            right_band: vec![0.0; layout.banded],
            border: vec![[0.0; EDGE]; layout.banded],
            corner: vec![[[0.0; EDGE]; EDGE]; self.radii.len()],
            right_edge: vec![[0.0; EDGE]; self.radii.len()],
        };
        let scale = 1.0 / (self.noise * self.noise);
        for Term { moved, settled, foot } in terms.iter().filter(|term| term.foot.weight > 0.0) {
            sums.used += 1;
            let rope = self.ropes[foot.curve];
            let weight = foot.weight * scale;
            let mut edge = [0.0; EDGE];
            if moves {
                let turn = cross(sub(*moved, self.center), *settled);
                edge[..3].copy_from_slice(&turn);
                edge[3..6].copy_from_slice(settled);
            }
            if layout.radii > 0 {
                edge[6] = -1.0;
            }
            for i in 0..EDGE {
                let x = weight * edge[i];
                sums.right_edge[rope][i] -= x * foot.residual;
                for j in 0..EDGE {
                    sums.corner[rope][i][j] += x * edge[j];
                }
            }
            if layout.banded > 0 {
                let (first, basis) = self.curves[foot.curve].basis(foot.parameter);
                let start = layout.offsets[foot.curve] + 3 * first;
                let rows = start..start + WIDTH;
                let jacobian: [f64; WIDTH] = std::array::from_fn(|i| -basis[i / 3] * foot.outward[i % 3]);
                let band = sums.band[rows.clone()].iter_mut();
                let border = sums.border[rows.clone()].iter_mut();
                let right = sums.right_band[rows].iter_mut();
                for (i, ((band, border), right)) in band.zip(border).zip(right).enumerate() {
                    let x = weight * jacobian[i];
                    *right -= x * foot.residual;
                    for (entry, y) in band[WIDTH - 1 - i..].iter_mut().zip(&jacobian) {
                        *entry += x * y;
                    }
                    for j in 0..EDGE {
                        border[j] += x * edge[j];
                    }
                }
            }
        }
        sums
    }

    /// One Gauss–Newton step. Returns its root mean square over the unknowns, or a radius' part if that is larger, in
    /// standard deviations.
    fn step(&mut self, terms: &[Vec<Term>], options: &TubeFitOptions) -> Result<f64> {
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
            let mut unit = vec![0.0; layout.border()];
            unit[column] = 1.0;
            let variance = factor.solve(&vec![0.0; layout.banded], &unit).1[column];
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
        let mut tight = false;
        for (i, curve) in self.curves.iter().enumerate().filter(|_| options.fit_curves) {
            let least = options.min_bend * self.radii[self.ropes[i]];
            let bends_too_tightly = |three: &[Point]| {
                let bend: Point = std::array::from_fn(|k| three[0][k] - 2.0 * three[1][k] + three[2][k]);
                let speed = sub(three[2], three[0]).map(|x| 0.5 * x);
                dot(bend, bend).sqrt() * least > dot(speed, speed)
            };
            if self.slack[i] > LEAST_SLACK && curve.control.windows(3).any(bends_too_tightly) {
                self.slack[i] *= STIFFENING;
                tight = true;
            }
        }
        tight
    }

    /// Standard deviations and covariances: the inverse of the normal equations' matrix.
    fn uncertainty(&self, terms: &[Vec<Term>], options: &TubeFitOptions) -> Result<Uncertainty> {
        let layout = self.layout(options);
        let (matrix, ..) = self.assemble(terms, &layout, options)?;
        let factor = matrix.factor().ok_or_else(undetermined)?;
        let inverse = |column: usize| {
            let mut unit = vec![0.0; layout.border()];
            unit[column] = 1.0;
            factor.solve(&vec![0.0; layout.banded], &unit).1
        };
        let poses = (0..self.views.len())
            .map(|view| match layout.column(view) {
                Some(column) => std::array::from_fn(|i| {
                    let row = inverse(column + i);
                    std::array::from_fn(|j| row[column + j])
                }),
                None => [[0.0; 6]; 6],
            })
            .collect();
        let radii = (0..self.radii.len())
            .map(|rope| match layout.radii {
                0 => 0.0,
                _ => inverse(layout.poses + rope)[layout.poses + rope].sqrt(),
            })
            .collect();
        let none = vec![0.0; layout.border()];
        let rows: Vec<usize> = (0..layout.banded).collect();
        let columns: Vec<[f64; 12]> = rows
            .par_iter()
            .map(|&row| {
                let mut unit = vec![0.0; layout.banded];
                unit[row] = 1.0;
                let inverse = factor.solve(&unit, &none).0;
                // from the first coordinate of the row's control point on
                let start = row - row % 3;
                std::array::from_fn(|k| inverse.get(start + k).copied().unwrap_or(0.0))
            })
            .collect();
        let curves = self
            .curves
            .iter()
            .zip(&layout.offsets)
            .map(|(curve, &offset)| {
                (0..curve.control.len())
                    .filter(|_| options.fit_curves)
                    .map(|i| {
                        std::array::from_fn(|block| {
                            std::array::from_fn(|a| {
                                std::array::from_fn(|b| columns[offset + 3 * i + a][3 * block + b])
                            })
                        })
                    })
                    .collect()
            })
            .collect();
        Ok(Uncertainty { poses, radii, curves })
    }
}

/// The residual along the viewing ray, with the tube's straight cylinder at the foot.
fn along_ray(foot: Foot, q: Point, to_camera: Point, tangent: Point, r: f64, band: f64) -> Foot {
    // across the axis: the ray is q + λ w, nearest to the axis at λ₀
    let w = advance(to_camera, -dot(to_camera, tangent), tangent);
    let square = dot(w, w) + 1e-12;
    let nearest = -dot(q, w) / square;
    let miss = advance(q, nearest, w);
    let gap = dot(miss, miss);
    if gap >= r * r {
        let residual = gap.sqrt() - r;
        let explained = residual < 0.25 * r;
        return Foot { residual, explained, inlier: explained && residual < band, ..foot };
    }
    let length = nearest + ((r * r - gap) / square).sqrt();
    let outward = normalized(advance(q, length, w));
    let facing = dot(outward, to_camera);
    let residual = -length * facing;
    let cosine = facing.max(0.4);
    let near = length.abs() < 1.2 * r;
    let weight = if near { tukey(residual, band * cosine.max(0.5)) / (cosine * cosine) } else { 0.0 };
    let inlier = residual.abs() < band;
    Foot { residual, outward, facing, explained: true, inlier, weight, ..foot }
}

impl Search {
    fn new(state: &State, residual: Residual) -> Self {
        let curves = &state.curves;
        let sample = |curve: usize, parameter: f64| {
            let place = curves[curve].at(parameter);
            let tangent = normalized(place.first);
            Sample {
                position: place.position,
                tangent,
                radius: state.radius(curve),
                place: OnCurve { curve, parameter },
            }
        };
        let samples: Vec<Sample> = (0..curves.len())
            .flat_map(|curve| {
                let parameters = curves[curve].parameters(SAMPLING * state.radius(curve));
                parameters.into_iter().map(move |parameter| sample(curve, parameter))
            })
            .collect();
        let positions: Vec<Point> = samples.iter().map(|sample| sample.position).collect();
        let grid = Grid::new(&positions, REACH * state.radii.iter().copied().fold(0.0, f64::max));
        let samples = grid.gather(&samples);
        let least_facing = if residual == Residual::Ray { -0.6 } else { -0.05 };
        Self { grid, samples, least_facing }
    }

    /// The place that explains a point best.
    fn place(&self, p: Point, to_camera: Point) -> Option<OnCurve> {
        let mut best = (f64::INFINITY, None);
        self.grid.visit_near(p, |i, position, _| {
            let sample = &self.samples[i];
            let r = sample.radius;
            let x = sub(p, position);
            let along = dot(x, sample.tangent);
            let q = advance(x, -along, sample.tangent);
            let d = dot(q, q).sqrt();
            let away = if dot(q, to_camera) < self.least_facing * d { 2.0 * r } else { 0.0 };
            let cost = (d - r).abs() + away + (along.abs() - 0.3 * r).max(0.0);
            if cost < best.0.min(1.2 * r) {
                best = (cost, Some(sample.place));
            }
            true
        });
        best.1
    }
}

/// Directions of a curve at places all along, each over a longer stretch.
///
/// A fitted curve wavers with the noise of its points, and so do its normals. Against a straight string's wavering a
/// view could slide until the noise fits best, and the normal equations would count that as information. The
/// direction over a longer stretch hardly wavers, and in a bend it is the tangent.
fn directions(curve: &Spline) -> Vec<Point> {
    let pieces = curve.pieces();
    let place = |u: f64| pieces.at(u.clamp(0.0, curve.end())).position;
    (0..=(curve.end() * DIRECTIONS) as usize)
        .map(|i| i as f64 / DIRECTIONS)
        .map(|u| normalized(sub(place(u + STRETCH), place(u - STRETCH))))
        .collect()
}

/// Unknowns of one view and rope: rotation, translation, the radius, and one that is always 0, for even numbers.
const EDGE: usize = 8;

/// One view's part of the normal equations, laid out as [`Bordered`] is, but for its own unknowns only.
struct ViewSums {
    /// Points that have a part.
    used: usize,
    band: Vec<[f64; WIDTH]>,
    right_band: Vec<f64>,
    border: Vec<[f64; EDGE]>,
    /// For each rope.
    corner: Vec<[[f64; EDGE]; EDGE]>,
    right_edge: Vec<[f64; EDGE]>,
}

fn undetermined() -> Error {
    Error::not_enough("points", "they do not fix the tubes")
}

/// Which unknown is where: control points in the band; poses, then the radii, in the border.
struct Layout {
    /// Where each curve's control points begin.
    offsets: Vec<usize>,
    banded: usize,
    poses: usize,
    radii: usize,
    reference: Option<usize>,
}

impl Layout {
    fn border(&self) -> usize {
        self.poses + self.radii
    }

    /// Where a view's six unknowns begin in the border; none for a view that stays.
    fn column(&self, view: usize) -> Option<usize> {
        self.reference.filter(|&fixed| fixed != view).map(|fixed| 6 * (view - usize::from(view > fixed)))
    }
}

fn smallest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Standard deviation from the median of sizes, for values about zero.
fn robust_sd(values: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    let middle = sizes.len() / 2;
    1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Tukey's biweight.
#[inline]
fn tukey(residual: f64, band: f64) -> f64 {
    let x = residual / band;
    if x.abs() < 1.0 { (1.0 - x * x).powi(2) } else { 0.0 }
}

/// Adds a curve's prior to the normal equations.
fn smoothness(curve: &Spline, offset: usize, r: f64, slack: f64, matrix: &mut Bordered, right: &mut [f64]) {
    let control = &curve.control;
    let mut difference = |stencil: &[f64], sd: f64| {
        let precision = sd.powi(-2);
        for i in 0..(control.len() + 1).saturating_sub(stencil.len()) {
            for k in 0..3 {
                let value: f64 = stencil.iter().enumerate().map(|(a, s)| s * control[i + a][k]).sum();
                for (a, x) in stencil.iter().enumerate() {
                    let row = offset + 3 * (i + a) + k;
                    right[row] -= precision * x * value;
                    for (b, y) in stencil[..=a].iter().enumerate() {
                        matrix.add_band(row, offset + 3 * (i + b) + k, precision * x * y);
                    }
                }
            }
        }
    };
    let span = curve.length() / curve.end();
    difference(&[-1.0, 3.0, -3.0, 1.0], THIRD_DIFFERENCE * r * (span / (1.5 * r)).powi(3));
    difference(&[1.0, -2.0, 1.0], SECOND_DIFFERENCE * r * slack);
    for i in 0..control.len() {
        let tangent = normalized(curve.at((i as f64 - 1.0).clamp(0.0, curve.end())).first);
        for a in 0..3 {
            let row = offset + 3 * i + a;
            matrix.add_band(row, row, 1e-2 / (r * r));
            for b in 0..=a {
                matrix.add_band(row, offset + 3 * i + b, tangent[a] * tangent[b] / (SLIDE * r).powi(2));
            }
        }
    }
}
