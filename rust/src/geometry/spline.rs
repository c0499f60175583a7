//! Uniform cubic B-spline curves.

use super::polyline::arc_length;
use super::vector::{Point, advance, cut_off, dot, sub};
use crate::checks::{check_finite, check_positive};
use crate::error::{Error, Result};

const MAX_SPANS: f64 = 5e3; // spans of a fitted curve at most
const BAND: usize = 4; // entries of a row of the fit's equations up to its diagonal: as many control points act together

/// A uniform cubic B-spline with n ≥ 4 control points. Its parameter runs from 0 to n − 3.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// Control points, metres.
    pub control: Vec<Point>,
}

/// A place on a curve, with its derivatives by the parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Position, metres.
    pub position: Point,
    /// First derivative.
    pub first: Point,
    /// Second derivative.
    pub second: Point,
}

impl Place {
    /// Returns the unit tangent and its derivative by arc length, 1/m; they are NaN where the curve stands still.
    pub fn tangent_and_curvature(&self) -> [Point; 2] {
        let (slope, bend) = (self.first, self.second);
        let (square, along) = (dot(slope, slope), dot(slope, bend));
        let length = square.sqrt();
        [slope.map(|x| x / length), std::array::from_fn(|k| (bend[k] - slope[k] * along / square) / square)]
    }
}

/// A spline as one cubic polynomial for each span, which is quicker to evaluate at many places.
pub(crate) struct Pieces {
    /// Coefficients of 1, t, t² and t³, where t runs from 0 to 1 in each span.
    spans: Vec<[Point; 4]>,
}

impl Pieces {
    /// Returns the position and derivatives at a parameter.
    #[inline]
    pub fn at(&self, u: f64) -> Place {
        let first = cut_off(u).min(self.spans.len() as u32 - 1);
        let t = u - f64::from(first);
        let c = &self.spans[first as usize];
        let mut place = Place { position: c[0], first: c[1], second: c[2] };
        for k in 0..3 {
            place.position[k] = c[0][k] + t * (c[1][k] + t * (c[2][k] + t * c[3][k]));
            place.first[k] = c[1][k] + t * (2.0 * c[2][k] + t * (3.0 * c[3][k]));
            place.second[k] = 2.0 * c[2][k] + 6.0 * t * c[3][k];
        }
        place
    }

    /// Returns the coefficients of 1, t, t² and t³ of a span.
    #[inline]
    pub fn span(&self, number: usize) -> [Point; 4] {
        self.spans[number]
    }

    /// The largest parameter.
    #[inline]
    pub fn end(&self) -> f64 {
        self.spans.len() as f64
    }
}

/// Returns the first of the four control points that act at a parameter, and the parameter within its span.
#[inline]
fn span(u: f64, controls: usize) -> (usize, f64) {
    let first = cut_off(u).min(controls as u32 - 4);
    (first as usize, u - f64::from(first))
}

/// Returns the weights of the four control points.
#[inline]
fn weights(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
        (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
        t * t * t / 6.0,
    ]
}

#[inline]
fn combine(control: &[Point], weights: [f64; 4]) -> Point {
    std::array::from_fn(|k| (0..4).map(|i| weights[i] * control[i][k]).sum())
}

impl Spline {
    /// Fits a curve to ordered nodes by least squares.
    ///
    /// Its spans are about `spacing` long. It continues straight by `extension` at both ends. A small penalty on third
    /// differences keeps it determined where nodes are sparse.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if a coordinate is not finite or a length is out of range; [`Error::NotEnoughData`]
    /// if there are fewer than two nodes or all are equal.
    ///
    /// ```
    /// let nodes: Vec<strand::Point> = (0..20).map(|i| [f64::from(i) * 0.01, 0.0, 0.0]).collect();
    /// let curve = strand::Spline::through(&nodes, 0.02, 0.0)?;
    /// assert!((curve.length() - 0.19).abs() < 1e-6);
    /// # Ok::<(), strand::Error>(())
    /// ```
    pub fn through(nodes: &[Point], spacing: f64, extension: f64) -> Result<Self> {
        const SMOOTHING: f64 = 1e-3; // weight of the bending against the distances from the nodes
        check_finite("nodes", nodes)?;
        check_positive("spacing", spacing)?;
        if !(0.0..1e6).contains(&extension) {
            return Err(Error::invalid("extension", format!("expected a length >= 0, got {extension}")));
        }
        let nodes = extend(nodes, extension)?;
        let arc = arc_length(&nodes);
        let length = arc[arc.len() - 1];
        if length > MAX_SPANS * spacing {
            return Err(Error::invalid("spacing", format!("gives more than {MAX_SPANS:e} spans: {spacing}")));
        }
        let controls = ((length / spacing).ceil() as usize).max(2) + 3;
        let samples = ((5.0 * length / spacing) as usize).max(20).max(2 * controls);
        // row i holds columns i + 1 − BAND to i of a symmetric matrix
        let mut normal = vec![[0.0; BAND]; controls];
        let mut right = vec![[0.0; 3]; controls];
        for i in 0..samples {
            let share = i as f64 / (samples - 1) as f64;
            let p = interpolate(&nodes, &arc, share * length);
            let (first, t) = span(share * (controls - 3) as f64, controls);
            let w = weights(t);
            for a in 0..4 {
                for b in 0..=a {
                    normal[first + a][BAND - 1 + b - a] += w[a] * w[b];
                }
                for k in 0..3 {
                    right[first + a][k] += w[a] * p[k];
                }
            }
        }
        let stiffness = SMOOTHING * samples as f64 / controls as f64;
        for i in 0..controls - 3 {
            let d = [-1.0, 3.0, -3.0, 1.0];
            for a in 0..4 {
                for b in 0..=a {
                    normal[i + a][BAND - 1 + b - a] += stiffness * d[a] * d[b];
                }
            }
        }
        let control = solve_banded(normal, right);
        Ok(Self { control: control.ok_or_else(|| Error::not_enough("nodes", "they do not fix a curve"))? })
    }

    /// Converts the curve to one polynomial for each span.
    pub(crate) fn pieces(&self) -> Pieces {
        let span = |c: &[Point]| {
            [[1.0, 4.0, 1.0, 0.0], [-3.0, 0.0, 3.0, 0.0], [3.0, -6.0, 3.0, 0.0], [-1.0, 3.0, -3.0, 1.0]]
                .map(|row| combine(c, row.map(|x| x / 6.0)))
        };
        Pieces { spans: self.control.windows(4).map(span).collect() }
    }

    /// The largest parameter.
    #[inline]
    pub fn end(&self) -> f64 {
        (self.control.len() - 3) as f64
    }

    /// Returns the position and derivatives at a parameter.
    #[inline]
    pub fn at(&self, u: f64) -> Place {
        let (first, t) = span(u, self.control.len());
        let control = &self.control[first..first + 4];
        let s = 1.0 - t;
        Place {
            position: combine(control, weights(t)),
            first: combine(
                control,
                [
                    -s * s / 2.0,
                    (3.0 * t * t - 4.0 * t) / 2.0,
                    (-3.0 * t * t + 2.0 * t + 1.0) / 2.0,
                    t * t / 2.0,
                ],
            ),
            second: combine(control, [s, 3.0 * t - 2.0, 1.0 - 3.0 * t, t]),
        }
    }

    /// Returns parameters about `spacing` of arc length apart, from end to end, at least two.
    pub fn parameters(&self, spacing: f64) -> Vec<f64> {
        let count = ((self.length() / spacing).ceil() as usize).max(1);
        (0..=count).map(|i| self.end() * i as f64 / count as f64).collect()
    }

    /// Returns the arc length from end to end, metres, by four-point Gauss–Legendre quadrature on each span.
    pub fn length(&self) -> f64 {
        (0..self.control.len() - 3).map(|i| self.length_between(i as f64, i as f64 + 1.0)).sum()
    }

    /// Returns the arc length between two parameters that differ by about one span at most, metres.
    pub fn length_between(&self, from: f64, to: f64) -> f64 {
        const PLACES: [(f64, f64); 4] = [
            (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
            (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        ];
        let (middle, half) = ((from + to) / 2.0, (to - from) / 2.0);
        half * PLACES
            .iter()
            .map(|&(x, w)| {
                let d = self.at(middle + half * x).first;
                w * dot(d, d).sqrt()
            })
            .sum::<f64>()
    }
}

/// A 3x3 matrix.
pub(crate) type Block = [Point; 3];

/// Returns the covariances of a spline's places at parameters, Σ Bᵢ Bⱼ Cᵢⱼ, m².
///
/// `covariances` holds those of each of four or more control points with itself and with the next three, m².
pub(crate) fn propagate_covariances(covariances: &[[Block; 4]], parameters: &[f64]) -> Vec<Block> {
    let propagate = |&u: &f64| {
        let (first, t) = span(u, covariances.len());
        let weights = weights(t);
        let mut total = [[0.0; 3]; 3];
        for i in 0..4 {
            for j in i..4 {
                let (weight, block) = (weights[i] * weights[j], &covariances[first + i][j - i]);
                for k in 0..3 {
                    for l in 0..3 {
                        let mirrored = if i == j { 0.0 } else { weight * block[l][k] };
                        total[k][l] += weight * block[k][l] + mirrored;
                    }
                }
            }
        }
        total
    };
    parameters.iter().map(propagate).collect()
}

/// Solves symmetric banded equations by Cholesky; returns None if the matrix is not positive definite.
///
/// The order of its sums is that of a dense matrix.
fn solve_banded(mut matrix: Vec<[f64; BAND]>, mut x: Vec<Point>) -> Option<Vec<Point>> {
    let n = matrix.len();
    // the place of an entry in its row
    let at = |row: usize, column: usize| BAND - 1 + column - row;
    for j in 0..n {
        let end = n.min(j + BAND);
        for k in (j + 1).saturating_sub(BAND)..j {
            for i in j..end.min(k + BAND) {
                matrix[i][at(i, j)] -= matrix[j][at(j, k)] * matrix[i][at(i, k)];
            }
        }
        let square = matrix[j][BAND - 1];
        if square <= 0.0 {
            return None;
        }
        matrix[j][BAND - 1] = square.sqrt();
        for i in j + 1..end {
            matrix[i][at(i, j)] /= matrix[j][BAND - 1];
        }
    }
    for j in 0..n {
        x[j] = x[j].map(|value| value / matrix[j][BAND - 1]);
        for i in j + 1..n.min(j + BAND) {
            x[i] = advance(x[i], -matrix[i][at(i, j)], x[j]);
        }
    }
    for j in (0..n).rev() {
        let known = (j + 1..n.min(j + BAND)).fold([0.0; 3], |sum, i| advance(sum, matrix[i][at(i, j)], x[i]));
        x[j] = sub(x[j], known).map(|value| value / matrix[j][BAND - 1]);
    }
    Some(x)
}

/// Continues nodes straight at both ends.
fn extend(nodes: &[Point], by: f64) -> Result<Vec<Point>> {
    let mut nodes = nodes.to_vec();
    nodes.dedup();
    if nodes.len() < 2 {
        return Err(Error::not_enough("nodes", "expected at least two different nodes"));
    }
    if by > 0.0 {
        let back = 3.min(nodes.len() - 1);
        let last = nodes.len() - 1;
        // nodes may return to where they were, or be too near for squares to differ
        let ahead = |end: usize, inner: &mut dyn Iterator<Item = usize>| -> Result<Point> {
            let from = inner.map(|i| sub(nodes[end], nodes[i])).find(|&d| dot(d, d) > 0.0);
            let d = from.ok_or_else(|| Error::not_enough("nodes", "expected nodes farther apart"))?;
            let scale = by / dot(d, d).sqrt();
            Ok(std::array::from_fn(|k| nodes[end][k] + scale * d[k]))
        };
        let front = ahead(0, &mut (1..=back).rev())?;
        let rear = ahead(last, &mut (last - back..last))?;
        nodes.insert(0, front);
        nodes.push(rear);
    }
    Ok(nodes)
}

/// Returns the point of a polyline at an arc length.
fn interpolate(nodes: &[Point], arc: &[f64], s: f64) -> Point {
    let i = arc.partition_point(|&a| a <= s).clamp(1, nodes.len() - 1);
    let step = arc[i] - arc[i - 1];
    let t = if step > 0.0 { ((s - arc[i - 1]) / step).clamp(0.0, 1.0) } else { 0.0 };
    std::array::from_fn(|k| nodes[i - 1][k] + t * (nodes[i][k] - nodes[i - 1][k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn helix(s: f64) -> Point {
        [0.03 * s.cos(), 0.03 * s.sin(), 0.004 * s]
    }

    #[test]
    fn a_curve_through_a_helix_has_its_places_derivatives_and_length() {
        let nodes: Vec<Point> = (0..400).map(|i| helix(f64::from(i) * 0.02)).collect();
        let spline = Spline::through(&nodes, 0.008, 0.0).unwrap();
        let length = 399.0 * 0.02 * (0.03f64 * 0.03 + 0.004 * 0.004).sqrt();
        assert!((spline.length() / length - 1.0).abs() < 1e-3);
        let pieces = spline.pieces();
        assert_eq!(pieces.end(), spline.end());
        for u in spline.parameters(0.002) {
            let place = spline.at(u);
            let same = pieces.at(u);
            for (a, b) in
                [(same.position, place.position), (same.first, place.first), (same.second, place.second)]
            {
                assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-15));
            }
            let radial = (place.position[0].powi(2) + place.position[1].powi(2)).sqrt();
            assert!((radial - 0.03).abs() < 2e-4, "{radial}");
            let h = 1e-5;
            if u > h && u < spline.end() - h {
                let (after, before) = (spline.at(u + h), spline.at(u - h));
                for k in 0..3 {
                    let first = (after.position[k] - before.position[k]) / (2.0 * h);
                    let second = (after.first[k] - before.first[k]) / (2.0 * h);
                    assert!((first - place.first[k]).abs() < 1e-8);
                    assert!((second - place.second[k]).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn banded_equations_have_the_bits_of_dense_ones() {
        let number = |i: usize| (i as f64 * 12.9898).sin();
        for n in [4, 5, 9, 40] {
            let mut dense = nalgebra::DMatrix::<f64>::zeros(n, n);
            let mut band = vec![[0.0; BAND]; n];
            for i in 0..n {
                for j in (i + 1).saturating_sub(BAND)..=i {
                    let value = number(7 * i + j) + if i == j { 5.0 } else { 0.0 };
                    band[i][BAND - 1 + j - i] = value;
                    (dense[(i, j)], dense[(j, i)]) = (value, value);
                }
            }
            let right: Vec<Point> = (0..n).map(|i| std::array::from_fn(|k| number(3 * i + k + 1))).collect();
            let found = solve_banded(band.clone(), right.clone()).unwrap();
            let cholesky = dense.cholesky().unwrap();
            for k in 0..3 {
                let one = nalgebra::DVector::from_iterator(n, right.iter().map(|p| p[k]));
                assert_eq!(cholesky.solve(&one).as_slice(), found.iter().map(|p| p[k]).collect::<Vec<f64>>());
            }
            band[n - 1][BAND - 1] = -1.0;
            assert!(solve_banded(band, right).is_none());
        }
    }

    #[test]
    fn curves_may_have_thousands_of_spans() {
        let nodes = [[0.0; 3], [4.9, 0.0, 0.0]];
        // dense equations take 10 s for each
        for _ in 0..20 {
            let curve = Spline::through(&nodes, 0.001, 0.0).unwrap();
            assert!(curve.control.len() > 4900 && (curve.length() - 4.9).abs() < 1e-6);
        }
        assert!(matches!(Spline::through(&nodes, 0.0009, 0.0), Err(Error::InvalidArgument { .. })));
    }

    #[test]
    fn an_extension_needs_nodes_that_are_apart() {
        let back = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0; 3]];
        let curve = Spline::through(&back, 0.5, 0.3).unwrap();
        assert!(curve.control.iter().flatten().all(|x| x.is_finite()));
        let tiny = back.map(|p| p.map(|x| 1e-300 * x));
        assert!(matches!(Spline::through(&tiny, 0.5, 0.3), Err(Error::NotEnoughData { .. })));
    }

    #[test]
    fn an_extension_is_straight_and_as_long_as_asked() {
        let nodes: Vec<Point> = (0..20).map(|i| [f64::from(i) * 0.01, 0.0, 0.0]).collect();
        let spline = Spline::through(&nodes, 0.008, 0.005).unwrap();
        assert!((spline.at(0.0).position[0] + 0.005).abs() < 1e-6);
        assert!((spline.at(spline.end()).position[0] - 0.195).abs() < 1e-6);
        assert!(Spline::through(&nodes[..1], 0.008, 0.0).is_err());
    }

    #[test]
    fn places_have_the_covariances_of_their_control_points() {
        let controls = 7;
        // control points that share a few random numbers: C is A Aᵀ, and far ones share none
        let mixed = |n: usize, k: usize, m: usize| {
            let shares = (n..n + 4).contains(&m);
            if shares { ((n * 31 + k * 17 + m * 7) % 13) as f64 - 6.0 } else { 0.0 }
        };
        let between = |n: usize, k: usize, o: usize, l: usize| -> f64 {
            (0..controls + 4).map(|m| mixed(n, k, m) * mixed(o, l, m)).sum()
        };
        let block = |n: usize, next: usize| {
            std::array::from_fn(|k| {
                std::array::from_fn(
                    |l| if n + next < controls { between(n, k, n + next, l) } else { f64::NAN },
                )
            })
        };
        let covariances: Vec<[Block; 4]> =
            (0..controls).map(|n| std::array::from_fn(|next| block(n, next))).collect();
        let parameters = [0.0, 0.3, 1.9, 3.0, 4.0];
        for (found, &u) in propagate_covariances(&covariances, &parameters).iter().zip(&parameters) {
            let (first, t) = span(u, controls);
            let weights = weights(t);
            for k in 0..3 {
                for l in 0..3 {
                    // the place is a sum of the same random numbers
                    let sum = |k, m| (0..4).map(|i| weights[i] * mixed(first + i, k, m)).sum::<f64>();
                    let expected: f64 = (0..controls + 4).map(|m| sum(k, m) * sum(l, m)).sum();
                    assert!((found[k][l] - expected).abs() < 1e-10);
                }
            }
        }
    }
}
