//! Eigenvectors of symmetric 3x3 matrices.

use super::vector::{Point, dot};
use crate::simd::{Doubles, LANES};

/// A symmetric 3x3 matrix as its upper triangle: xx, xy, xz, yy, yz, zz.
pub type Symmetric3 = [f64; 6];

/// Eigenvalues in ascending order, and their unit eigenvectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigen3 {
    /// λ₀ ≤ λ₁ ≤ λ₂.
    pub values: [f64; 3],
    /// Row i belongs to λᵢ.
    pub vectors: [Point; 3],
}

/// Finds the eigenvalues and eigenvectors of a symmetric matrix by cyclic Jacobi rotations.
///
/// The result is accurate to rounding for any finite matrix, even with equal eigenvalues, and the time is bounded
/// (Golub and Van Loan, Matrix Computations, 8.5).
pub fn eigen_symmetric(matrix: &Symmetric3) -> Eigen3 {
    // scale by the largest entry, so that squares neither overflow nor underflow
    let size = matrix.iter().fold(0.0, |size: f64, x| size.max(x.abs())).max(f64::MIN_POSITIVE);
    let [xx, xy, xz, yy, yz, zz] = matrix.map(|x| x / size);
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // four sweeps reach rounding; the others are for badly scaled matrices
    for _ in 0..12 {
        let off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        let diagonal = a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2];
        if off <= 1e-32 * diagonal {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    Eigen3 { values: order.map(|i| size * a[i][i]), vectors: order.map(|i| v[i]) }
}

/// Applies one Jacobi rotation in the plane of axes p and q, which makes the entry (p, q) of `a` zero.
#[inline]
fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    let other = 3 - p - q;
    let apq = a[p][q];
    a[p][p] -= t * apq;
    a[q][q] += t * apq;
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    let (ap, aq) = (a[other][p], a[other][q]);
    a[other][p] = c * ap - s * aq;
    a[p][other] = a[other][p];
    a[other][q] = s * ap + c * aq;
    a[q][other] = a[other][q];
    for k in 0..3 {
        let (vp, vq) = (v[p][k], v[q][k]);
        v[p][k] = c * vp - s * vq;
        v[q][k] = s * vp + c * vq;
    }
}

/// Finds the unit eigenvectors of the smallest eigenvalues of eight positive semidefinite matrices.
///
/// Also returns each eigenvalue's share of the trace, and whether vector and share are accurate to rounding. They are
/// if the two smallest eigenvalues differ by more than a thousandth of the largest and the residual is only rounding.
///
/// Newton's iteration on the characteristic polynomial finds the eigenvalue from below. The adjugate of A − λ gives its
/// eigenvector. Two steps of Rayleigh's iteration, again by the adjugate, make both exact.
#[inline(always)]
pub fn least_eigenvectors(matrices: &[Doubles; 6]) -> ([Doubles; 3], Doubles, [bool; LANES]) {
    let (mut vectors, mut shares, mut certain) = ([[0.0; LANES]; 3], [0.0; LANES], [false; LANES]);
    for l in 0..LANES {
        let entries: Symmetric3 = std::array::from_fn(|i| matrices[i][l]);
        let trace = entries[0] + entries[3] + entries[5];
        let unit = 1.0 / if trace > f64::MIN_POSITIVE { trace } else { f64::MIN_POSITIVE };
        let a: Symmetric3 = std::array::from_fn(|i| entries[i] * unit);
        let minors = adjugate(&a, 0.0);
        let quadratic = minors[0] + minors[3] + minors[5];
        let determinant = a[0] * minors[0] + a[1] * minors[1] + a[2] * minors[2];
        let mut value = 0.0;
        for _ in 0..5 {
            let function = ((value - 1.0) * value + quadratic) * value - determinant;
            let slope = (3.0 * value - 2.0) * value + quadratic;
            value -= function / slope;
        }
        let m = adjugate(&a, value);
        // the column with the largest entry on the diagonal
        let first = m[0] > m[3] && m[0] > m[5];
        let second = m[3] > m[5];
        let choose = |x: f64, y: f64, z: f64| {
            let other = if second { y } else { z };
            if first { x } else { other }
        };
        let v = [choose(m[0], m[1], m[2]), choose(m[1], m[3], m[4]), choose(m[2], m[4], m[5])];
        let rayleigh = |v: Point| times(&adjugate(&a, dot(v, times(&a, v)) / dot(v, v)), v);
        let v = rayleigh(rayleigh(v));
        let inverse = 1.0 / dot(v, v).sqrt();
        let v = v.map(|x| x * inverse);
        let v_a = times(&a, v);
        let value = dot(v, v_a);
        // the other two eigenvalues from their sum and product
        let half = 0.5 * (1.0 - value);
        let product = quadratic - 2.0 * value * half;
        let apart = half * half - product;
        let apart = if apart > 0.0 { apart.sqrt() } else { 0.0 };
        let off: Point = std::array::from_fn(|k| v_a[k] - value * v[k]);
        certain[l] = half - apart - value > 1e-3 * (half + apart) && dot(off, off) < 1e-27;
        for k in 0..3 {
            vectors[k][l] = v[k];
        }
        shares[l] = if value > 0.0 { value } else { 0.0 };
    }
    (vectors, shares, certain)
}

/// Returns the adjugate of A − λ.
#[inline(always)]
fn adjugate(a: &Symmetric3, value: f64) -> Symmetric3 {
    let [xx, xy, xz, yy, yz, zz] = [a[0] - value, a[1], a[2], a[3] - value, a[4], a[5] - value];
    [
        yy * zz - yz * yz,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xx * zz - xz * xz,
        xy * xz - xx * yz,
        xx * yy - xy * xy,
    ]
}

/// Returns A v.
#[inline(always)]
fn times(a: &Symmetric3, v: Point) -> Point {
    [
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        a[1] * v[0] + a[3] * v[1] + a[4] * v[2],
        a[2] * v[0] + a[4] * v[1] + a[5] * v[2],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, SymmetricEigen, Vector3};
    use proptest::prelude::*;

    fn full(m: &Symmetric3) -> Matrix3<f64> {
        Matrix3::new(m[0], m[1], m[2], m[1], m[3], m[4], m[2], m[4], m[5])
    }

    proptest! {
        #[test]
        fn eigenvectors_satisfy_their_equation_and_agree_with_nalgebra(
            entries in prop::array::uniform6(-1.0f64..1.0), scale in -140i32..140, rank in 0usize..3,
        ) {
            let mut m = entries.map(|x| x * 10f64.powi(scale));
            if rank == 1 {
                let [x, y, z, ..] = entries;
                m = [x * x, x * y, x * z, y * y, y * z, z * z];
            } else if rank == 2 {
                m = [entries[0], 0.0, 0.0, entries[0], 0.0, entries[1]];
            }
            let size = full(&m).norm();
            let eigen = eigen_symmetric(&m);
            for (value, vector) in eigen.values.iter().zip(&eigen.vectors) {
                let x = Vector3::from(*vector);
                prop_assert!((x.norm() - 1.0).abs() < 1e-14);
                prop_assert!((full(&m) * x - x * *value).norm() <= 4e-15 * size);
            }
            let mut expected = SymmetricEigen::try_new(full(&m), f64::EPSILON, 1000).unwrap().eigenvalues;
            expected.as_mut_slice().sort_by(f64::total_cmp);
            for (got, want) in eigen.values.iter().zip(expected.iter()) {
                prop_assert!((got - want).abs() <= 1e-14 * size);
            }
        }

        #[test]
        fn eight_least_eigenvectors_are_those_of_nalgebra(
            roots in prop::array::uniform8(prop::array::uniform3(prop::array::uniform3(-1.0f64..1.0))),
            scale in -100i32..100, flat in 0.0f64..1.0,
        ) {
            // B Bᵀ, where one direction may be as short as noise on a surface
            let squares = roots.map(|root| {
                let b = Matrix3::from_fn(|i, j| root[i][j] * if j == 2 { flat } else { 1.0 });
                b * b.transpose() * 10f64.powi(scale)
            });
            let places = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
            let entries = places.map(|place| std::array::from_fn(|l| squares[l][place]));
            let (vectors, shares, certain) = least_eigenvectors(&entries);
            for (l, square) in squares.iter().enumerate() {
                let eigen = SymmetricEigen::try_new(square / square.amax(), f64::EPSILON, 1000).unwrap();
                let mut order = [0, 1, 2];
                order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
                let [low, middle, high] = order.map(|i| eigen.eigenvalues[i]);
                let gap = (middle - low) / high;
                if !certain[l] {
                    // the gap of a zero matrix is NaN
                    prop_assert!(gap.is_nan() || gap < 0.3, "{gap} apart");
                    continue;
                }
                let v = Vector3::from_fn(|k, _| vectors[k][l]);
                let expected = eigen.eigenvectors.column(order[0]);
                prop_assert!((v.norm() - 1.0).abs() < 1e-14);
                prop_assert!(v.cross(&expected).norm() < 2e-13 / gap, "{} at {gap}", v.cross(&expected).norm());
                prop_assert!((shares[l] - (low / (low + middle + high)).max(0.0)).abs() < 1e-13);
            }
        }
    }
}
