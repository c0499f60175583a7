//! Joint fit of tubes and camera poses to surface points.
//!
//! Unknowns are the control points of one spline for each arc, a small rigid motion of each view about the pose that
//! was reported, and the radius. A point's residual is its distance from the tube's surface; so opposite
//! half-shells of a tube, which pull into each other when points are matched with points, are told apart by construction.

use nalgebra::{Matrix3, Rotation3, Vector3};
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
/// After a step of less than this, in standard deviations of the unknowns, points keep to their curves, and their feet
/// move on from where they were.
const SETTLED: f64 = 2.0;
/// After a step of less than this, in standard deviations of the unknowns, another changes nothing that the data tell.
const TOLERANCE: f64 = 0.1;
/// How far to both sides a curve's direction is taken where poses are concerned, in spans.
const STRETCH: f64 = 2.0;
/// At how many places of a span it is taken.
const DIRECTIONS: f64 = 8.0;

/// What one camera saw.
#[derive(Debug, Clone, Copy)]
pub struct TubeView<'a> {
    /// Surface points in the world frame, as the reported pose places them, metres.
    pub points: &'a [Point],
    /// The camera's centre in the world frame, as reported, metres.
    pub viewpoint: Point,
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TubeFitOptions {
    /// Whether curves change.
    pub fit_curves: bool,
    /// Whether the radius changes.
    pub fit_radius: bool,
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
    /// Extraction range, low and high corner, metres. Noise carries points out of it but none in, so points whose
    /// place on the tube lies within two standard deviations of its faces have no part.
    pub bounds: Option<[Point; 2]>,
    /// Whether to work out how well the unknowns are fixed.
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
}

/// The outcome of a joint fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeFit {
    /// The curves.
    pub curves: Vec<Spline>,
    /// For each view, the rigid motion of the world frame that corrects its reported pose.
    pub motions: Vec<RigidMotion>,
    /// The radius, metres.
    pub radius: f64,
    /// Robust standard deviation of the residuals, metres.
    pub sigma: f64,
    /// The last limit beyond which residuals did not count, metres.
    pub band: f64,
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
    /// Standard deviations of each view's rotation vector, radians, and translation, metres; 0 for a view that stays.
    pub poses: Vec<[f64; 6]>,
    /// Standard deviation of the radius, metres; 0 if it was given.
    pub radius: f64,
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
    radius: f64,
    sigma: f64,
    /// Standard deviation of a point whose weight is 1: of its residual, or of the noise along its ray.
    noise: f64,
}

/// A place of a curve that points are compared with.
#[derive(Clone, Copy)]
struct Sample {
    position: Point,
    tangent: Point,
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
    radius: f64,
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
/// Gauss–Newton with Tukey's loss whose limit shrinks from `band[0]` to `band[1]`, but stays at three standard
/// deviations of the residuals. Poses have the reported ones as a prior; curves one of small third differences, which
/// matters only where points are few.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, a number is out of range, or a curve has
/// fewer than four control points; [`NotEnoughData`](Error::NotEnoughData) if no point lies near a curve, or the points
/// do not fix the unknowns.
pub fn fit_tubes(
    views: &[TubeView],
    curves: &[Spline],
    motions: &[RigidMotion],
    radius: f64,
    options: &TubeFitOptions,
) -> Result<TubeFit> {
    check_positive("radius", radius)?;
    for view in views {
        check_finite("points", view.points)?;
        check_finite("viewpoint", &[view.viewpoint])?;
    }
    if curves.is_empty() || curves.iter().any(|curve| curve.control.len() < 4) {
        return Err(Error::invalid(
            "curves",
            "expected at least one curve, each with four control points or more",
        ));
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
    for band in options.band {
        check_positive("band", band)?;
    }
    for curve in curves {
        check_finite("curves", &curve.control)?;
    }
    let spans: f64 = curves.iter().map(|curve| curve.length() / radius).sum();
    if spans > MOST_RADII {
        let reason = format!("the curves are {spans:.1e} radii long, more than {MOST_RADII:e}");
        return Err(Error::invalid("radius", reason));
    }
    let all: Vec<Point> = views.iter().map(|view| centroid(view.points)).collect();
    let center = centroid(&all);
    let mut state = State {
        views,
        curves: curves.to_vec(),
        motions: motions.to_vec(),
        twists: motions.iter().map(|motion| twist(motion, center)).collect(),
        center,
        radius,
        sigma: 0.2 * radius,
        noise: 0.2 * radius,
    };
    parallel::run(|| state.run(radius, options))
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
    fn run(&mut self, start_radius: f64, options: &TubeFitOptions) -> Result<TubeFit> {
        let mut iteration = 0;
        let mut step = f64::INFINITY;
        let mut terms = Vec::new();
        loop {
            let share = iteration as f64 / options.iterations.saturating_sub(1).max(1) as f64;
            let planned =
                (options.band[0] + (options.band[1] - options.band[0]) * share.min(1.0)) * self.radius;
            let least = if iteration > 2 { 4.5 * self.sigma } else { 0.6 * self.radius };
            let band = planned.max(least).min(1.2 * self.radius);
            let done = iteration == options.iterations;
            let known = (step < SETTLED).then_some(terms);
            terms = self.terms(options, band, known.as_deref());
            self.measure(&terms, options.residual, band);
            if done {
                return self.result(terms, band, iteration, options);
            }
            step = self.step(&terms, start_radius, options)?;
            iteration += 1;
            if iteration > 4 && step < TOLERANCE {
                let terms = self.terms(options, band, Some(&terms));
                return self.result(terms, band, iteration, options);
            }
        }
    }

    fn result(
        &self,
        terms: Vec<Vec<Term>>,
        band: f64,
        iterations: usize,
        options: &TubeFitOptions,
    ) -> Result<TubeFit> {
        let uncertainty = options.uncertainty.then(|| self.uncertainty(&terms, options)).transpose()?;
        Ok(TubeFit {
            uncertainty,
            curves: self.curves.clone(),
            motions: self.motions.clone(),
            radius: self.radius,
            sigma: self.sigma,
            band,
            feet: terms.into_iter().map(|view| view.into_iter().map(|term| term.foot).collect()).collect(),
            iterations,
        })
    }

    /// The feet of all points at the current curves, poses and radius; on the curves that they are known to be on.
    fn terms(&self, options: &TubeFitOptions, band: f64, known: Option<&[Vec<Term>]>) -> Vec<Vec<Term>> {
        let search = known.is_none().then(|| Search::new(&self.curves, self.radius, options.residual));
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
                    self.foot(moved, to_camera, start, &pieces[start.curve], options.residual, band);
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
        let surface = advance(axis, self.radius, foot.outward);
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
        band: f64,
    ) -> Foot {
        let r = self.radius;
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
                Foot { residual: d - r, outward, facing, explained, weight, ..foot }
            }
            Residual::Ray => self.along_ray(foot, q, to_camera, tangent, band),
        }
    }

    /// The residual along the viewing ray, with the tube's straight cylinder at the foot.
    fn along_ray(&self, foot: Foot, q: Point, to_camera: Point, tangent: Point, band: f64) -> Foot {
        let r = self.radius;
        // across the axis: the ray is q + λ w, nearest to the axis at λ₀
        let w = advance(to_camera, -dot(to_camera, tangent), tangent);
        let square = dot(w, w) + 1e-12;
        let nearest = -dot(q, w) / square;
        let miss = advance(q, nearest, w);
        let gap = dot(miss, miss);
        if gap >= r * r {
            return Foot { residual: gap.sqrt() - r, explained: gap.sqrt() < 1.25 * r, ..foot };
        }
        let length = nearest + ((r * r - gap) / square).sqrt();
        let outward = normalized(advance(q, length, w));
        let facing = dot(outward, to_camera);
        let residual = -length * facing;
        let cosine = facing.max(0.4);
        let near = length.abs() < 1.2 * r;
        let weight = if near { tukey(residual, band * cosine.max(0.5)) / (cosine * cosine) } else { 0.0 };
        Foot { residual, outward, facing, explained: true, weight, ..foot }
    }

    /// Updates the standard deviations of residuals and of noise.
    fn measure(&mut self, terms: &[Vec<Term>], residual: Residual, band: f64) {
        let used: Vec<&Foot> = terms
            .iter()
            .flatten()
            .map(|term| &term.foot)
            .filter(|foot| foot.explained && foot.residual.abs() < band)
            .collect();
        if used.len() > 50 {
            let least = 0.02 * self.radius;
            self.sigma = robust_sd(used.iter().map(|foot| foot.residual)).max(least);
            self.noise = match residual {
                Residual::Distance => self.sigma,
                Residual::Ray => {
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
            radius: options.fit_radius,
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
            let poses =
                layout.column(view).into_iter().flat_map(|column| (0..6).map(move |k| (k, column + k)));
            let edges: Vec<(usize, usize)> =
                poses.chain(layout.radius.then_some((6, layout.poses))).collect();
            for (i, &(from, to)) in edges.iter().enumerate() {
                right_border[to] += sums.right_edge[from];
                for &(other, column) in &edges[..=i] {
                    matrix.add_corner(to, column, sums.corner[from][other]);
                }
                for (row, border) in sums.border.iter().enumerate() {
                    matrix.add_border(row, to, border[from]);
                }
            }
        }
        if used < 10 {
            return Err(Error::not_enough("points", format!("only {used} of them lie on a tube")));
        }
        if options.fit_curves {
            for (curve, &offset) in self.curves.iter().zip(&layout.offsets) {
                smoothness(curve, offset, self.radius, &mut matrix, &mut right_band);
            }
        }
        let precision: [f64; 6] = std::array::from_fn(|k| options.pose_sd[k / 3].powi(-2));
        for (view, twist) in self.twists.iter().enumerate() {
            if let Some(column) = layout.column(view) {
                for k in 0..6 {
                    matrix.add_corner(column + k, column + k, precision[k]);
                    right_border[column + k] -= precision[k] * twist[k];
                }
            }
        }
        Ok((matrix, right_band, right_border))
    }

    /// One view's part of the normal equations.
    fn view_sums(&self, terms: &[Term], moves: bool, layout: &Layout) -> ViewSums {
        let mut sums = ViewSums {
            used: 0,
            band: vec![[0.0; WIDTH]; layout.banded],
            right_band: vec![0.0; layout.banded],
            border: vec![[0.0; EDGE]; layout.banded],
            corner: [[0.0; EDGE]; EDGE],
            right_edge: [0.0; EDGE],
        };
        let scale = 1.0 / (self.noise * self.noise);
        for Term { moved, settled, foot } in terms.iter().filter(|term| term.foot.weight > 0.0) {
            sums.used += 1;
            let weight = foot.weight * scale;
            let mut edge = [0.0; EDGE];
            if moves {
                let turn = cross(sub(*moved, self.center), *settled);
                edge[..3].copy_from_slice(&turn);
                edge[3..6].copy_from_slice(settled);
            }
            if layout.radius {
                edge[6] = -1.0;
            }
            for i in 0..EDGE {
                let x = weight * edge[i];
                sums.right_edge[i] -= x * foot.residual;
                for j in 0..EDGE {
                    sums.corner[i][j] += x * edge[j];
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

    /// One Gauss–Newton step. Returns its root mean square over the unknowns, or the radius' part if that is larger, in
    /// standard deviations.
    fn step(&mut self, terms: &[Vec<Term>], start_radius: f64, options: &TubeFitOptions) -> Result<f64> {
        let r = self.radius;
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
            for (curve, &offset) in self.curves.iter_mut().zip(&layout.offsets) {
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
        if options.fit_radius {
            let mut unit = vec![0.0; layout.border()];
            unit[layout.poses] = 1.0;
            let variance = factor.solve(&vec![0.0; layout.banded], &unit).1[layout.poses];
            // one unknown among many, and all the others follow it
            size = size.max(edges[layout.poses].abs() / variance.sqrt());
            let step = edges[layout.poses].clamp(-0.15 * r, 0.15 * r);
            self.radius = (r + step).clamp(0.5 * start_radius, 2.0 * start_radius);
        }
        Ok(size)
    }

    /// Standard deviations and covariances: the inverse of the normal equations' matrix.
    fn uncertainty(&self, terms: &[Vec<Term>], options: &TubeFitOptions) -> Result<Uncertainty> {
        let layout = self.layout(options);
        let (matrix, ..) = self.assemble(terms, &layout, options)?;
        let factor = matrix.factor().ok_or_else(undetermined)?;
        let variance = |column: usize| {
            let mut unit = vec![0.0; layout.border()];
            unit[column] = 1.0;
            factor.solve(&vec![0.0; layout.banded], &unit).1[column]
        };
        let poses = (0..self.views.len())
            .map(|view| match layout.column(view) {
                Some(column) => std::array::from_fn(|k| variance(column + k).sqrt()),
                None => [0.0; 6],
            })
            .collect();
        let radius = if layout.radius { variance(layout.poses).sqrt() } else { 0.0 };
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
        Ok(Uncertainty { poses, radius, curves })
    }
}

impl Search {
    fn new(curves: &[Spline], radius: f64, residual: Residual) -> Self {
        let sample = |curve: usize, parameter: f64| {
            let place = curves[curve].at(parameter);
            let tangent = normalized(place.first);
            Sample { position: place.position, tangent, place: OnCurve { curve, parameter } }
        };
        let samples: Vec<Sample> = (0..curves.len())
            .flat_map(|curve| {
                let parameters = curves[curve].parameters(SAMPLING * radius);
                parameters.into_iter().map(move |parameter| sample(curve, parameter))
            })
            .collect();
        let positions: Vec<Point> = samples.iter().map(|sample| sample.position).collect();
        let grid = Grid::new(&positions, REACH * radius);
        let samples = grid.gather(&samples);
        let least_facing = if residual == Residual::Ray { -0.6 } else { -0.05 };
        Self { grid, samples, radius, least_facing }
    }

    /// The place that explains a point best.
    fn place(&self, p: Point, to_camera: Point) -> Option<OnCurve> {
        let r = self.radius;
        let mut best = (1.2 * r, None);
        self.grid.visit_near(p, |i, position, _| {
            let sample = &self.samples[i];
            let x = sub(p, position);
            let along = dot(x, sample.tangent);
            let q = advance(x, -along, sample.tangent);
            let d = dot(q, q).sqrt();
            let away = if dot(q, to_camera) < self.least_facing * d { 2.0 * r } else { 0.0 };
            let cost = (d - r).abs() + away + (along.abs() - 0.3 * r).max(0.0);
            if cost < best.0 {
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

/// Unknowns of one view: rotation, translation, the radius, and one that is always 0, for even numbers.
const EDGE: usize = 8;

/// One view's part of the normal equations, laid out as [`Bordered`] is, but for its own unknowns only.
struct ViewSums {
    /// Points that have a part.
    used: usize,
    band: Vec<[f64; WIDTH]>,
    right_band: Vec<f64>,
    border: Vec<[f64; EDGE]>,
    corner: [[f64; EDGE]; EDGE],
    right_edge: [f64; EDGE],
}

fn undetermined() -> Error {
    Error::not_enough("points", "they do not fix the tubes")
}

/// Which unknown is where: control points in the band; poses, then the radius, in the border.
struct Layout {
    /// Where each curve's control points begin.
    offsets: Vec<usize>,
    banded: usize,
    poses: usize,
    radius: bool,
    reference: Option<usize>,
}

impl Layout {
    fn border(&self) -> usize {
        self.poses + usize::from(self.radius)
    }

    /// Where a view's six unknowns begin in the border; none for a view that stays.
    fn column(&self, view: usize) -> Option<usize> {
        self.reference.filter(|&fixed| fixed != view).map(|fixed| 6 * (view - usize::from(view > fixed)))
    }
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
fn smoothness(curve: &Spline, offset: usize, r: f64, matrix: &mut Bordered, right: &mut [f64]) {
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
    difference(&[1.0, -2.0, 1.0], SECOND_DIFFERENCE * r);
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
