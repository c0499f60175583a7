//! Normal equations of control points, poses and biases, summed sample by sample.

use super::curves::Curves;
use crate::geometry::Point;
use crate::geometry::bordered::Bordered;

/// The bordering unknowns of a view.
#[derive(Debug, Clone, Copy)]
pub struct Columns {
    /// The first of its pose's six unknowns; None if the pose is held.
    pub pose: Option<usize>,
    pub bias: usize,
}

/// A residual of one sample in one view.
#[derive(Debug, Clone, Copy)]
pub struct Residual {
    pub value: f64,
    pub weight: f64,
    /// Its derivative by the sample's position in the world.
    pub by_place: Point,
    /// Its derivatives by the view's pose.
    pub by_pose: [f64; 6],
    pub by_bias: f64,
}

/// Sums of products of residuals and derivatives for each sample; those of the control points follow from them.
#[derive(Debug, Default)]
pub struct Sums {
    /// For each sample: xx, xy, yy, xz, yz, zz.
    squares: Vec<[f64; 6]>,
    gradients: Vec<Point>,
    /// For each sample and coordinate, the products with the bordering unknowns.
    border: Vec<f64>,
    /// The lower half, row by row.
    corner: Vec<f64>,
    border_gradient: Vec<f64>,
}

impl Sums {
    /// Resets to zero, for `samples` samples and `m` bordering unknowns.
    pub fn clear(&mut self, samples: usize, m: usize) {
        let zeros = |v: &mut Vec<f64>, n: usize| {
            v.clear();
            v.resize(n, 0.0);
        };
        self.squares.clear();
        self.squares.resize(samples, [0.0; 6]);
        self.gradients.clear();
        self.gradients.resize(samples, [0.0; 3]);
        zeros(&mut self.border, 3 * samples * m);
        zeros(&mut self.corner, m * m);
        zeros(&mut self.border_gradient, m);
    }

    /// Adds a residual that depends only on a sample's position.
    #[inline]
    pub fn add_place(&mut self, sample: usize, by_place: Point, value: f64, weight: f64) {
        let [x, y, z] = by_place;
        let [wx, wy, wz] = by_place.map(|d| weight * d);
        let s = &mut self.squares[sample];
        s[0] += wx * x;
        s[1] += wx * y;
        s[2] += wy * y;
        s[3] += wx * z;
        s[4] += wy * z;
        s[5] += wz * z;
        let g = &mut self.gradients[sample];
        g[0] += wx * value;
        g[1] += wy * value;
        g[2] += wz * value;
    }

    #[inline]
    pub fn add(&mut self, sample: usize, columns: Columns, residual: &Residual) {
        let Residual { value, weight, by_place, by_pose, by_bias } = *residual;
        self.add_place(sample, by_place, value, weight);
        let m = self.border_gradient.len();
        if let Some(first) = columns.pose {
            for k in 0..3 {
                let scaled = weight * by_place[k];
                let start = (3 * sample + k) * m + first;
                for (sum, d) in self.border[start..start + 6].iter_mut().zip(&by_pose) {
                    *sum += scaled * d;
                }
            }
            for a in 0..6 {
                let scaled = weight * by_pose[a];
                let start = (first + a) * m + first;
                for (sum, d) in self.corner[start..=start + a].iter_mut().zip(&by_pose) {
                    *sum += scaled * d;
                }
                self.border_gradient[first + a] += scaled * value;
            }
        }
        if by_bias != 0.0 {
            let scaled = weight * by_bias;
            for k in 0..3 {
                self.border[(3 * sample + k) * m + columns.bias] += scaled * by_place[k];
            }
            if let Some(first) = columns.pose {
                for a in 0..6 {
                    let (row, column) = (columns.bias.max(first + a), columns.bias.min(first + a));
                    self.corner[row * m + column] += scaled * by_pose[a];
                }
            }
            self.corner[columns.bias * (m + 1)] += scaled * by_bias;
            self.border_gradient[columns.bias] += scaled * value;
        }
    }

    /// Carries the sums from samples to control points.
    pub fn assemble(&self, curves: &Curves, matrix: &mut Bordered, gradient: &mut [f64]) {
        let m = self.border_gradient.len();
        let mut scaled = vec![0.0; m];
        for (i, sample) in curves.samples.iter().enumerate() {
            let [xx, xy, yy, xz, yz, zz] = self.squares[i];
            let square = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            for a in 0..4 {
                let row = 3 * (sample.first + a);
                for b in 0..=a {
                    let both = sample.weights[a] * sample.weights[b];
                    for k in 0..3 {
                        for l in 0..if a == b { k + 1 } else { 3 } {
                            matrix.add_band(row + k, 3 * (sample.first + b) + l, both * square[k][l]);
                        }
                    }
                }
                for k in 0..3 {
                    gradient[row + k] += sample.weights[a] * self.gradients[i][k];
                    let start = (3 * i + k) * m;
                    for (to, from) in scaled.iter_mut().zip(&self.border[start..start + m]) {
                        *to = sample.weights[a] * from;
                    }
                    matrix.add_border(row + k, 0, &scaled);
                }
            }
        }
        for a in 0..m {
            for b in 0..=a {
                matrix.add_corner(a, b, self.corner[a * m + b]);
            }
        }
    }

    /// Half the gradient by the bordering unknowns.
    pub fn border_gradient(&self) -> &[f64] {
        &self.border_gradient
    }
}
