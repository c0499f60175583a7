//! The Gauss–Newton iteration: its steps and its end.

use nalgebra::{Matrix3, Matrix6, Rotation3, SymmetricEigen, Vector3};

use super::equations::{SECOND_DIFFERENCE, refuse_undetermined};
use super::foot_points::ViewTerms;
use super::input::{Residual, TubeFitOptions, goes_on};
use super::outcome::{TubeFit, Uncertainty};
use super::state::{State, find_least, find_twist};
use super::sums::Wanted;
use crate::error::Result;
use crate::geometry::median::MEDIAN_TO_SD;
use crate::geometry::schur::Solver;
use crate::geometry::{Point, RigidMotion, advance, dot, sub};

/// Factor of the standard deviation of second differences after a step in which a curve bends too tightly.
const STIFFENING: f64 = 0.5;
const MIN_BEND_SCALE: f64 = 1e-4; // least product of these factors
/// Stiffening ends when residuals grew by this share, because the points do bend that tightly.
const STRAINED: f64 = 0.01;
/// Second differences of such a curve may then reach this root mean square, standard deviations of the prior.
const MAX_STRAIN: f64 = 3.0;
/// Tukey's limit for 95 % of the efficiency of least squares on normal noise, standard deviations of the noise.
const EFFICIENT: f64 = 4.685;
/// After a smaller step, points stay on their curves, and the search starts at their foot points; standard deviations
/// of the unknowns.
const SETTLED: f64 = 2.0;
const FIRST_STEPS: usize = 2; // steps before Tukey's limit follows the scatter of the residuals
/// The data fix a direction of a pose if its standard deviation is below this share of the reported pose's.
const FIXED: f64 = std::f64::consts::FRAC_1_SQRT_2;
const HOLD: f64 = 1e4; // in other directions the view is held with this multiple of the reported precision
const STEPS_HELD: usize = 6; // further steps with held views at most
const MAX_ROTATIONS: usize = 1000; // iterations for the eigenvectors of a 6x6 matrix at most; they take about a dozen

impl State<'_> {
    pub(super) fn run(mut self, options: &TubeFitOptions) -> Result<TubeFit> {
        // a continued fit need not begin with a wide limit again: its first steps count as taken
        let (taken, mut step, mut terms) = match goes_on(self.views) {
            true => (FIRST_STEPS, 0.0, self.begun()),
            false => (0, f64::INFINITY, Vec::new()),
        };
        let last = if options.uncertainty { sums_for_steps(options) } else { Wanted::Nothing };
        let mut iteration = taken;
        loop {
            let share = iteration as f64 / options.iterations.saturating_sub(1).max(1) as f64;
            let planned = options.band[0] + (options.band[1] - options.band[0]) * share.min(1.0);
            let bands: Vec<f64> = (self.radii.iter())
                .map(|r| {
                    let least = if iteration > FIRST_STEPS { EFFICIENT * self.noise } else { 0.6 * r };
                    (planned * r).max(least).min(1.2 * r)
                })
                .collect();
            let done = iteration >= options.iterations;
            let known = (step < SETTLED).then_some(terms);
            terms = self.terms(options, &bands, known, if done { last } else { sums_for_steps(options) });
            self.measure(&terms, options);
            if done {
                return self.result(terms, &bands, iteration - taken, options);
            }
            step = self.step(&terms, options)?;
            iteration += 1;
            if !self.stiffen(options) && iteration > FIRST_STEPS + 1 && step < options.tolerance {
                let terms = self.terms(options, &bands, Some(terms), last);
                return self.result(terms, &bands, iteration - taken, options);
            }
        }
    }

    /// Holds views at the reported poses in directions that the data do not fix; returns whether there are any.
    ///
    /// In such a direction the data mostly show noise that the curves follow, so views would wander.
    fn hold(&mut self, uncertainty: &Uncertainty, options: &TubeFitOptions) -> Result<bool> {
        let sd: [f64; 6] = std::array::from_fn(|k| options.pose_sd[k / 3]);
        let mut open = false;
        for (held, covariance) in self.held.iter_mut().zip(&uncertainty.poses) {
            let scaled = Matrix6::from_fn(|i, j| covariance[i][j] / (sd[i] * sd[j]));
            let eigen = SymmetricEigen::try_new(scaled, f64::EPSILON, MAX_ROTATIONS)
                .ok_or_else(refuse_undetermined)?;
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
        Ok(open)
    }

    fn result(
        &mut self,
        mut terms: Vec<ViewTerms>,
        bands: &[f64],
        mut iterations: usize,
        options: &TubeFitOptions,
    ) -> Result<TubeFit> {
        let uncertainty = match (options.uncertainty, options.shared) {
            (false, _) => None,
            (true, [1.0, 1.0]) => Some(self.uncertainty(&terms, options)?),
            (true, shared) => {
                let counts = shared.map(|count| count.powf(-0.5) as f32);
                let (known, wanted) = (Some(terms.clone()), sums_for_steps(options));
                let counted = self.terms_counted(options, bands, known, wanted, Some(counts));
                Some(self.uncertainty(&counted, options)?)
            }
        };
        let open = uncertainty.as_ref().map_or(Ok(false), |uncertainty| self.hold(uncertainty, options))?;
        if open {
            for _ in 0..STEPS_HELD {
                let step = self.step(&terms, options)?;
                terms = self.terms(options, bands, Some(terms), sums_for_steps(options));
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
            foot_points: self.foot_points(&terms),
            iterations,
        })
    }

    /// Updates the standard deviations of residuals and of noise.
    fn measure(&mut self, terms: &[ViewTerms], options: &TubeFitOptions) {
        let count = terms.iter().map(|terms| terms.near.len()).sum();
        let along = options.residual == Residual::Ray && options.noise.is_none();
        let mut sizes = Vec::with_capacity(count);
        let mut along_rays = Vec::with_capacity(if along { count } else { 0 });
        for (curve, run) in terms.iter().flat_map(ViewTerms::on_curves) {
            let radius = self.radius(curve) as f32;
            for near in run.iter().filter(|near| near.inlier) {
                let size = radius * near.residual.abs();
                sizes.push(size);
                if along {
                    along_rays.push(size / near.facing.max(0.4));
                }
            }
        }
        if sizes.len() > 50 {
            let least = 0.02 * find_least(&self.radii);
            self.sigma = estimate_sd(sizes).max(least);
            self.least_sigma = self.least_sigma.min(self.sigma);
            self.noise = match (options.residual, options.noise) {
                (Residual::Distance, _) => self.sigma,
                (Residual::Ray, Some(noise)) => noise,
                (Residual::Ray, None) => estimate_sd(along_rays).max(least),
            };
        }
    }

    /// Takes one Gauss–Newton step. Returns its size in standard deviations of the unknowns: the root mean square over
    /// all, or the step of a radius if that is larger.
    fn step(&mut self, terms: &[ViewTerms], options: &TubeFitOptions) -> Result<f64> {
        let layout = self.layout(options);
        if layout.banded + layout.border() == 0 {
            return Ok(0.0);
        }
        let (matrix, right_band, right_border) = self.assemble(terms, &layout, options)?;
        let solver = Solver::new(matrix, &layout.blocks()).ok_or_else(refuse_undetermined)?;
        let (controls, edges) = solver.solve(&right_band, &right_border);
        let gained: f64 =
            right_band.iter().zip(&controls).chain(right_border.iter().zip(&edges)).map(|(a, b)| a * b).sum();
        // weights of tiny noise exceed all numbers
        if !gained.is_finite() {
            return Err(refuse_undetermined());
        }
        if options.fit_curves {
            for (number, (curve, &offset)) in self.curves.iter_mut().zip(&layout.offsets).enumerate() {
                let r = self.radii[self.radius_classes[number]];
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
                self.motions[view] = move_about(step, self.center).after(&self.motions[view]);
                self.twists[view] = find_twist(&self.motions[view], self.center);
            }
        }
        let mut size = (gained / (controls.len() + edges.len()) as f64).sqrt();
        if layout.radii > 0 {
            let variances = solver.border_variances(layout.poses..layout.border());
            for class in 0..layout.radii {
                let column = layout.poses + class;
                // a radius is one unknown among many, but all others follow it
                size = size.max(edges[column].abs() / variances[class].sqrt());
                let (r, start) = (self.radii[class], self.start_radii[class]);
                let step = edges[column].clamp(-0.15 * r, 0.15 * r);
                self.radii[class] = (r + step).clamp(0.5 * start, 2.0 * start);
            }
        }
        Ok(size)
    }

    /// Stiffens curves that bend too tightly; returns whether there are any.
    fn stiffen(&mut self, options: &TubeFitOptions) -> bool {
        if !options.fit_curves || self.strained {
            return false;
        }
        self.strained = self.sigma > (1.0 + STRAINED) * self.least_sigma;
        let mut tight = false;
        for (i, curve) in self.curves.iter().enumerate() {
            let r = self.radii[self.radius_classes[i]];
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
                let follows = mean.sqrt() / (MAX_STRAIN * SECOND_DIFFERENCE * r);
                self.bend_scale[i] = self.bend_scale[i].max(follows).min(1.0);
            } else if self.bend_scale[i] > MIN_BEND_SCALE && threes.clone().any(bends_too_tightly) {
                self.bend_scale[i] *= STIFFENING;
                tight = true;
            }
        }
        tight
    }
}

/// Returns the rigid motion that turns by a rotation vector about a point and then translates.
fn move_about(step: [f64; 6], center: Point) -> RigidMotion {
    let rotation: Matrix3<f64> = Rotation3::new(Vector3::new(step[0], step[1], step[2])).into_inner();
    let c = Vector3::from(center);
    RigidMotion { rotation, translation: c - rotation * c + Vector3::new(step[3], step[4], step[5]) }
}

/// Returns the sums that steps need.
fn sums_for_steps(options: &TubeFitOptions) -> Wanted {
    if options.fit_curves { Wanted::All } else { Wanted::Held }
}

/// Returns the standard deviation of values about zero, from the median of their sizes.
fn estimate_sd(sizes: Vec<f32>) -> f64 {
    // the bits of positive numbers have their order
    let mut bits: Vec<u32> = sizes.into_iter().map(f32::to_bits).collect();
    let middle = bits.len() / 2;
    MEDIAN_TO_SD * f64::from(f32::from_bits(*bits.select_nth_unstable(middle).1))
}
