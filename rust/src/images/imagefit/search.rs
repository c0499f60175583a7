//! The fit: Gauss–Newton steps of curves, poses and biases together.

use rayon::prelude::*;

use super::camera::{Plane, RopeView, Sensor};
use super::cost;
use super::curves::Curves;
use super::equations::{Columns, Sums};
use super::evidence::{Scene, Seen};
use super::outcome::{ImageFit, Misfit};
use super::places::{OnChain, Place2, STEP, TOUCHING};
use super::residuals::{measure_depth_scatter, measure_edge_scatter};
use crate::geometry::bordered::{Bordered, Factor, WIDTH};
use crate::geometry::schur::Solver;
use crate::geometry::{Point, advance, dot, normalized, sub};

const BEND: f64 = 2.0; // cost of bending, for each ∫ κ² ds with lengths in radii
const CHANGE: f64 = 200.0; // cost of changes of bending, for each ∫ (dκ/ds)² ds with lengths in radii
const LIMITS: [f64; 2] = [1.6, 0.9]; // limits of the mask's votes far from the solution and near it, image radii
const FAR: f64 = 0.4; // share of a first fit's steps with the first limit
const TABLE: f64 = 4.0; // weight of the table, for each radius of length
const ORDER: f64 = 6.0; // weight of the order at crossings, for each radius of length
const REST: f64 = 2.0; // weight with which a rope rests on the table, for each radius of length
const NEAR: f64 = 0.5; // height at which that weight decreases, radii; more in noise of more than a radius
const FALL: f64 = 4.0; // weight that keeps an unsupported end from rising, for each radius of length
const CARRIED: f64 = 3.0; // height of an axis that another strand carries, radii
const PAIRS: f64 = 6.0; // pairs of a crossing that count in full
const MAX_STEP: f64 = 1.0; // step of a control point at most, radii
const SETTLED: f64 = 0.01; // the fit ends after a smaller step, radii
const DAMPING: f64 = 1e-2; // damping of a control point's step, which keeps the matrix positive definite, 1/radii²

/// Settings of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageFitOptions {
    /// Gauss–Newton steps at most.
    pub iterations: usize,
    /// The first of them that also take the mask's votes far from the chains; see [`count_far`].
    pub far: usize,
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

/// Returns how many steps of a first fit also take votes far from the chains.
pub fn count_far(iterations: usize) -> usize {
    (FAR * iterations as f64).ceil() as usize
}

/// Fits curves to the views, starting with chains in space.
///
/// `crossings` holds the pairs of places of each crossing that the reference sees, the upper strand's first. None if
/// the equations have no solution.
pub fn fit(
    views: &[RopeView],
    chains: &[Vec<Point>],
    radius: f64,
    plane: Option<Plane>,
    crossings: &[Vec<[OnChain; 2]>],
    sensor: &Sensor,
    options: &ImageFitOptions,
) -> Option<ImageFit> {
    let curves = Curves::through(chains, radius);
    let mut columns = Vec::new();
    let mut unknowns = 0;
    for v in 0..views.len() {
        let pose = options.held.is_some_and(|held| held != v).then_some(unknowns);
        unknowns += if pose.is_some() { 6 } else { 0 };
        columns.push(Columns { pose, bias: unknowns });
        unknowns += 1;
    }
    let pairs = crossings
        .iter()
        .flat_map(|pairs| {
            let weight = ORDER * STEP / (pairs.len() as f64 / PAIRS).max(1.0);
            pairs.iter().map(move |&pair| (pair, weight))
        })
        .map(|(pair, weight)| (pair.map(|place| curves.nearest(place)), weight))
        .collect();
    let state = State {
        views,
        radius,
        plane,
        pairs,
        sensor,
        options,
        curves,
        columns,
        unknowns,
        corrections: vec![[0.0; 6]; views.len()],
        biases: vec![-sensor.bias[0]; views.len()],
        positions: Vec::new(),
        tangents: Vec::new(),
        seen: views.iter().map(|_| Seen::default()).collect(),
        ends: Vec::new(),
        sums: Sums::default(),
    };
    state.run()
}

struct State<'a> {
    views: &'a [RopeView<'a>],
    radius: f64,
    plane: Option<Plane>,
    /// Pairs of samples, the upper one first, and their weights.
    pairs: Vec<([usize; 2], f64)>,
    sensor: &'a Sensor,
    options: &'a ImageFitOptions,
    curves: Curves,
    columns: Vec<Columns>,
    unknowns: usize,
    corrections: Vec<[f64; 6]>,
    biases: Vec<f64>,
    positions: Vec<Point>,
    tangents: Vec<Point>,
    seen: Vec<Seen>,
    /// The ends in the reference's image at the start.
    ends: Vec<Place2>,
    sums: Sums,
}

impl State<'_> {
    fn run(mut self) -> Option<ImageFit> {
        let most = self.options.iterations;
        let mut taken = 0;
        self.update();
        let reference = &self.seen[self.options.reference];
        self.ends = self.curves.ends().map(|i| reference.image[i]).collect();
        let blocks: Vec<usize> = self.columns.iter().map(|view| view.pose.unwrap_or(view.bias)).collect();
        while taken < most {
            crate::parallel::go_on();
            let far = taken < self.options.far;
            let (matrix, band, border) = self.equations(LIMITS[usize::from(!far)]);
            let (step, rest) = Solver::new(matrix, &blocks)?.solve(&band, &border);
            let largest = step.iter().fold(0.0, |most: f64, x| most.max(x.abs())) / self.radius;
            if !largest.is_finite() {
                return None;
            }
            self.step(&step, &rest, (MAX_STEP / largest.max(1e-9)).min(1.0));
            self.update();
            taken += 1;
            if largest < SETTLED && !far {
                break;
            }
        }
        let depth = measure_depth_scatter(self.seen.iter().map(|s| s.depth_errors.as_slice()), &self.curves);
        let lateral = measure_edge_scatter(self.seen.iter().flat_map(|s| &s.edge_errors));
        let covariances = if self.options.uncertainty {
            let (matrix, ..) = self.equations(LIMITS[1]);
            self.covariances(&matrix.factor()?)
        } else {
            Vec::new()
        };
        let (misfit, areas) = self.misfit();
        let nodes = self.curves.chains.iter().map(|chain| self.positions[chain.clone()].to_vec()).collect();
        Some(ImageFit {
            curves: self.curves.splines(),
            nodes,
            covariances,
            corrections: self.corrections,
            biases: self.biases,
            depth,
            lateral,
            misfit,
            areas,
            iterations: taken,
        })
    }

    /// Updates the samples in the world and in all views.
    fn update(&mut self) {
        self.curves.place(&mut self.positions, &mut self.tangents);
        let of_view = |((view, seen), correction): ((&RopeView, &mut Seen), &[f64; 6])| {
            seen.update(view, correction, &self.positions, &self.curves);
        };
        self.views.par_iter().zip(&mut self.seen).zip(&self.corrections).for_each(of_view);
    }

    /// Returns the matrix, and minus half the gradient.
    fn equations(&mut self, limit: f64) -> (Bordered, Vec<f64>, Vec<f64>) {
        let find = |(view, seen): (&RopeView, &mut Seen)| seen.find_votes(view, &self.curves, limit);
        self.views.par_iter().zip(&mut self.seen).for_each(find);
        let sums = &mut self.sums;
        sums.clear(self.curves.samples.len(), self.unknowns);
        for (v, view) in self.views.iter().enumerate() {
            let scene = Scene {
                view,
                columns: self.columns[v],
                curves: &self.curves,
                tangents: &self.tangents,
                radius: self.radius,
                sensor: self.sensor,
            };
            let seen = &mut self.seen[v];
            seen.add_edge(&scene, limit, sums);
            seen.add_inside(&scene, sums);
            if v == self.options.reference {
                seen.add_ends(&scene, &self.ends, sums);
            }
            seen.add_depth(&scene, self.options.noise, self.biases[v], sums);
        }
        for (i, &t) in self.tangents.iter().enumerate() {
            // samples do not slide along the rope
            sums.add_place(i, t.map(|x| x / self.radius), 0.0, STEP);
        }
        self.add_table();
        self.add_order();

        let n = 3 * self.curves.control.len();
        let mut matrix = Bordered::zeros(n, self.unknowns);
        let mut band = vec![0.0; n];
        self.sums.assemble(&self.curves, &mut matrix, &mut band);
        self.curves.stiffen(BEND, CHANGE, &mut matrix, &mut band);
        for i in 0..n {
            matrix.add_band(i, i, DAMPING / (self.radius * self.radius));
        }
        let mut border = self.sums.border_gradient().to_vec();
        for (v, columns) in self.columns.iter().enumerate() {
            let [usual, sd] = self.sensor.bias;
            let weight = sd.powi(-2);
            matrix.add_corner(columns.bias, columns.bias, weight);
            border[columns.bias] += weight * (self.biases[v] + usual);
            if let Some(first) = columns.pose {
                for k in 0..6 {
                    let weight = self.options.pose_sd[k / 3].powi(-2);
                    matrix.add_corner(first + k, first + k, weight);
                    border[first + k] += weight * self.corrections[v][k];
                }
            }
        }
        for x in band.iter_mut().chain(&mut border) {
            *x = -*x;
        }
        (matrix, band, border)
    }

    /// Adds the table: nothing lies below it, ropes near it rest on it, and ends rise no higher than the rope before
    /// them.
    fn add_table(&mut self) {
        let Some(plane) = self.plane else { return };
        let near = NEAR.max(self.options.noise - NEAR);
        for (i, &x) in self.positions.iter().enumerate() {
            let e = plane.height(x) / self.radius - 1.0;
            let rests = REST / (1.0 + (e / near).powi(2)).powi(2);
            let weight = if e < 0.0 { TABLE } else { rests };
            let by = plane.normal.map(|n| n / self.radius);
            let t = self.tangents[i];
            self.sums.add_place(i, advance(by, -dot(by, t), t), e, weight * STEP);
        }
        for (i, from) in self.curves.caps() {
            let [end, inner] = [i, from].map(|i| plane.height(self.positions[i]) / self.radius);
            // a strand on the table may carry the end; a rope that comes from higher up hangs from something else
            let e = end - inner.max(CARRIED);
            if e > 0.0 {
                let weight = FALL / (1.0 + (inner - CARRIED).max(0.0).powi(2)).powi(2);
                self.sums.add_place(i, plane.normal.map(|n| n / self.radius), e, weight * STEP);
            }
        }
    }

    /// Adds the order of touching strands, as far apart along the ray as their thickness requires.
    ///
    /// It uses (a − b)² ≤ 2 (a − m)² + 2 (b − m)² with m midway. The right side does not couple the strands, and has
    /// the same minimum.
    fn add_order(&mut self) {
        let camera: Point = self.views[self.options.reference].pose.translation.into();
        let thick = (TOUCHING * self.radius).powi(2);
        for &([upper, lower], weight) in &self.pairs {
            let between = sub(self.positions[lower], self.positions[upper]);
            let ray = normalized(sub(self.positions[upper], camera));
            let gap = dot(between, ray);
            let lateral = dot(between, between) - gap * gap;
            let e = (gap - (thick - lateral).max(0.0).sqrt()) / self.radius;
            if e < 0.0 {
                let by = ray.map(|x| x / self.radius);
                self.sums.add_place(lower, by, 0.5 * e, 2.0 * weight);
                self.sums.add_place(upper, by.map(|x| -x), 0.5 * e, 2.0 * weight);
            }
        }
    }

    fn step(&mut self, step: &[f64], rest: &[f64], part: f64) {
        for (control, step) in self.curves.control.iter_mut().zip(step.as_chunks::<3>().0) {
            *control = advance(*control, part, *step);
        }
        for (v, columns) in self.columns.iter().enumerate() {
            self.biases[v] += part * rest[columns.bias];
            if let Some(first) = columns.pose {
                for k in 0..6 {
                    self.corrections[v][k] += part * rest[first + k];
                }
            }
        }
    }

    /// Returns the misfit, and the areas of each view.
    fn misfit(&self) -> (Misfit, Vec<[f64; 3]>) {
        let of_view = |((view, seen), &bias): ((&RopeView, &Seen), &f64)| {
            cost::measure_view(view, seen, &self.curves, bias, self.radius, self.sensor)
        };
        let found: Vec<Misfit> =
            self.views.par_iter().zip(&self.seen).zip(&self.biases).map(of_view).collect();
        let mean = |part: fn(&Misfit) -> f64| found.iter().map(part).sum::<f64>() / found.len() as f64;
        let (bend, change) = self.curves.bending();
        let misfit = Misfit {
            uncovered: mean(|m| m.uncovered),
            outside: mean(|m| m.outside),
            spilled: mean(|m| m.spilled),
            depth: mean(|m| m.depth),
            depths: mean(|m| m.depths),
            bend,
            change,
        };
        let areas = found.iter().map(|m| [m.uncovered, m.outside, m.spilled]).collect();
        (misfit, areas)
    }

    /// Returns the covariances of the samples.
    fn covariances(&self, factor: &Factor) -> Vec<Vec<[Point; 3]>> {
        let (inverse, _) = factor.inverse();
        let entry = |i: usize, j: usize| inverse[i.max(j)][i.min(j) + WIDTH - 1 - i.max(j)];
        let of = |i: usize| -> [Point; 3] {
            let sample = &self.curves.samples[i];
            let mut sum = [[0.0; 3]; 3];
            for a in 0..4 {
                for b in 0..4 {
                    let both = sample.weights[a] * sample.weights[b];
                    for k in 0..3 {
                        for l in 0..3 {
                            let (row, column) = (3 * (sample.first + a) + k, 3 * (sample.first + b) + l);
                            sum[k][l] += both * entry(row, column);
                        }
                    }
                }
            }
            sum
        };
        self.curves.chains.iter().map(|chain| chain.clone().map(of).collect()).collect()
    }
}
