//! The normal equations from the points, the end observations and the priors.

use std::collections::BTreeMap;

use super::foot_points::ViewTerms;
use super::input::{EndObservation, TubeFitOptions};
use super::outcome::Uncertainty;
use super::state::State;
use super::sums::{Band, RESIDUAL};
use crate::error::{Error, Result};
use crate::geometry::bordered::{Bordered, WIDTH};
use crate::geometry::spline::Spline;
use crate::geometry::{cross, dot, normalized, sub};

/// Standard deviation of the prior on third differences of control points, for spans of 1.5 radii, radii. Third
/// differences of one curve grow with the cube of the spans.
const THIRD_DIFFERENCE: f64 = 0.1;
/// Standard deviation of the prior on second differences of control points, radii.
pub(super) const SECOND_DIFFERENCE: f64 = 6.0;
const SLIDE: f64 = 0.05; // standard deviation of the prior on the sliding of a control point along its curve, radii

/// The order of the unknowns: control points in the band; poses, then radii, in the border.
pub(super) struct Layout {
    /// The first control point of each curve.
    pub(super) offsets: Vec<usize>,
    pub(super) banded: usize,
    pub(super) poses: usize,
    pub(super) radii: usize,
    reference: Option<usize>,
}

impl Layout {
    pub(super) fn border(&self) -> usize {
        self.poses + self.radii
    }

    /// Returns the first unknown in the border of each pose and each radius.
    pub(super) fn blocks(&self) -> Vec<usize> {
        (0..self.poses).step_by(6).chain(self.poses..self.border()).collect()
    }

    /// Returns the first of a view's six unknowns in the border; None for a view that stays.
    pub(super) fn column(&self, view: usize) -> Option<usize> {
        self.reference.filter(|&fixed| fixed != view).map(|fixed| 6 * (view - usize::from(view > fixed)))
    }
}

impl State<'_> {
    /// Lays out the unknowns.
    pub(super) fn layout(&self, options: &TubeFitOptions) -> Layout {
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

    /// Assembles the normal equations at foot points: the matrix, and the right-hand sides of its band and its border.
    pub(super) fn assemble(
        &self,
        terms: &[ViewTerms],
        layout: &Layout,
        options: &TubeFitOptions,
    ) -> Result<(Bordered, Vec<f64>, Vec<f64>)> {
        let mut matrix = Bordered::zeros(layout.banded, layout.border());
        let mut right_band = vec![0.0; layout.banded];
        let mut right_border = vec![0.0; layout.border()];
        let scale = 1.0 / (self.noise * self.noise);
        let mut used = 0;
        let mut bands: Vec<Vec<Band>> = self
            .curves
            .iter()
            .filter(|_| options.fit_curves)
            .map(|curve| vec![Band::default(); curve.control.len() - 3])
            .collect();
        for (view, terms) in terms.iter().enumerate() {
            let column = layout.column(view);
            for sums in &terms.sums {
                used += sums.used;
                let radius = (layout.radii > 0).then_some(layout.poses + self.radius_classes[sums.curve]);
                if options.fit_curves {
                    sums.add_band_to(&mut bands[sums.curve][sums.first]);
                    let start = layout.offsets[sums.curve] + 3 * sums.first;
                    for i in 0..WIDTH {
                        let border = sums.border(i, -scale);
                        right_band[start + i] -= border[RESIDUAL];
                        if let Some(column) = column {
                            matrix.add_border(start + i, column, &border[..6]);
                        }
                        if let Some(column) = radius {
                            matrix.add_border(start + i, column, &border[6..7]);
                        }
                    }
                }
                let edges: [Option<usize>; RESIDUAL] =
                    std::array::from_fn(|k| if k < 6 { column.map(|column| column + k) } else { radius });
                for (from, to) in edges.iter().enumerate() {
                    let Some(to) = *to else { continue };
                    let corner = sums.corner(from, scale);
                    right_border[to] -= corner[RESIDUAL];
                    for (&sum, column) in corner.iter().zip(&edges[..=from]) {
                        if let Some(column) = *column {
                            matrix.add_corner(to, column, sum);
                        }
                    }
                }
            }
        }
        for (spans, offset) in bands.iter().zip(&layout.offsets) {
            for (first, band) in spans.iter().enumerate() {
                let start = offset + 3 * first;
                band.visit(|i, j, sum| matrix.add_band(start + i, start + j, scale * sum));
            }
        }
        if used < 10 {
            return Err(Error::not_enough("points", format!("only {used} of them lie on a tube")));
        }
        if options.fit_curves {
            for (i, (curve, &offset)) in self.curves.iter().zip(&layout.offsets).enumerate() {
                add_smoothness(
                    curve,
                    offset,
                    self.radius(i),
                    self.bend_scale[i],
                    &mut matrix,
                    &mut right_band,
                );
            }
        }
        for (class, [mean, sd]) in options.radius_prior.iter().flatten().enumerate() {
            let column = layout.poses + class;
            matrix.add_corner(column, column, sd.powi(-2));
            right_border[column] -= (self.radii[class] - mean) / (sd * sd);
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

    /// Adds the end observations. Each end has one place along its rope, an unknown that is eliminated here.
    fn add_ends(&self, layout: &Layout, matrix: &mut Bordered, right: &mut [f64]) {
        let mut ends: BTreeMap<usize, Vec<(usize, &EndObservation)>> = BTreeMap::new();
        for (view, seen) in self.views.iter().enumerate() {
            for observation in seen.end_observations {
                ends.entry(observation.end).or_default().push((view, observation));
            }
        }
        for observations in ends.values() {
            let rows: Vec<(Option<usize>, [f64; 6], f64, f64)> = observations
                .iter()
                .map(|&(view, observation)| {
                    let moved = self.motions[view].apply(observation.place);
                    let arm = sub(moved, self.center);
                    let (turn, along) = (cross(arm, observation.outward), dot(arm, observation.outward));
                    let jacobian =
                        std::array::from_fn(|k| if k < 3 { turn[k] } else { observation.outward[k - 3] });
                    (layout.column(view), jacobian, along, observation.sd.powi(-2))
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

    /// Computes standard deviations and covariances from the inverse of the normal matrix.
    pub(super) fn uncertainty(&self, terms: &[ViewTerms], options: &TubeFitOptions) -> Result<Uncertainty> {
        let layout = self.layout(options);
        let (matrix, ..) = self.assemble(terms, &layout, options)?;
        let factor = matrix.factor().ok_or_else(refuse_undetermined)?;
        let (band, border) = factor.inverse();
        let poses = (0..self.views.len())
            .map(|view| match layout.column(view) {
                Some(column) => {
                    std::array::from_fn(|i| std::array::from_fn(|j| border[(column + i, column + j)]))
                }
                None => [[0.0; 6]; 6],
            })
            .collect();
        let radii = (0..self.radii.len())
            .map(|class| match layout.radii {
                0 => 0.0,
                _ => border[(layout.poses + class, layout.poses + class)].sqrt(),
            })
            .collect();
        // the covariance of a coordinate with one at most WIDTH − 1 rows later
        let entry = |row: usize, column: usize| {
            let (row, column) = (row.max(column), row.min(column));
            if row < band.len() && row - column < WIDTH { band[row][column + WIDTH - 1 - row] } else { 0.0 }
        };
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
                                std::array::from_fn(|b| {
                                    entry(offset + 3 * i + a, offset + 3 * (i + block) + b)
                                })
                            })
                        })
                    })
                    .collect()
            })
            .collect();
        Ok(Uncertainty { poses, radii, curves })
    }
}

pub(super) fn refuse_undetermined() -> Error {
    Error::not_enough("points", "they do not fix the tubes")
}

/// Adds a curve's prior to the normal equations.
fn add_smoothness(
    curve: &Spline,
    offset: usize,
    r: f64,
    bend_scale: f64,
    matrix: &mut Bordered,
    right: &mut [f64],
) {
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
    difference(&[1.0, -2.0, 1.0], SECOND_DIFFERENCE * r * bend_scale);
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
