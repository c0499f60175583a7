//! Rigid motions.

use nalgebra::{Matrix3, Vector3};

use super::vector::Point;
use crate::error::{Error, Result};

/// A rotation followed by a translation: x ↦ R x + t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion {
    /// R.
    pub rotation: Matrix3<f64>,
    /// t, metres.
    pub translation: Vector3<f64>,
}

impl RigidMotion {
    /// Returns the motion that changes nothing.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// Reads a 4x4 matrix, row by row, as a rigid motion.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if the matrix is not finite, its last row is not (0, 0, 0, 1), or its 3x3 part
    /// scales, shears or mirrors by more than 1e-6.
    pub fn from_rows(rows: &[[f64; 4]; 4]) -> Result<Self> {
        let refuse =
            |reason: &str| Err(Error::invalid("pose", format!("expected a rigid motion, but {reason}")));
        if !rows.iter().flatten().all(|x| x.is_finite()) {
            return refuse("it holds NaN or infinity");
        }
        if rows[3].iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(a, b)| (a - b).abs() > 1e-9) {
            return refuse("its last row is not (0, 0, 0, 1)");
        }
        let rotation = Matrix3::from_fn(|i, j| rows[i][j]);
        let off = rotation * rotation.transpose() - Matrix3::identity();
        if off.amax() > 1e-6 || rotation.determinant() < 0.0 {
            return refuse("its 3x3 part is not a rotation");
        }
        Ok(Self { rotation, translation: Vector3::new(rows[0][3], rows[1][3], rows[2][3]) })
    }

    /// Returns the 4x4 matrix, row by row.
    pub fn to_rows(&self) -> [[f64; 4]; 4] {
        let mut rows = [[0.0; 4]; 4];
        for i in 0..3 {
            for j in 0..3 {
                rows[i][j] = self.rotation[(i, j)];
            }
            rows[i][3] = self.translation[i];
        }
        rows[3][3] = 1.0;
        rows
    }

    /// Returns R x + t.
    #[inline]
    pub fn apply(&self, x: Point) -> Point {
        let (r, t) = (&self.rotation, &self.translation);
        let mut moved = [0.0; 3];
        for k in 0..3 {
            moved[k] = r[(k, 0)] * x[0] + r[(k, 1)] * x[1] + r[(k, 2)] * x[2] + t[k];
        }
        moved
    }

    /// Returns the motion that applies `first` and then this one.
    ///
    /// The rotation is made orthonormal again, so that long products stay rigid.
    pub fn after(&self, first: &Self) -> Self {
        let product = self.rotation * first.rotation;
        // Newton's step towards the nearest rotation: an error e becomes 3/4 e² (Higham 1986)
        let rotation = product * (Matrix3::identity() * 3.0 - product.transpose() * product) * 0.5;
        Self { rotation, translation: self.rotation * first.translation + self.translation }
    }
}

/// Returns how far a change of the motion of points moves one of them at most, metres; 0 without points.
pub fn measure_shift(points: &[Point], before: &RigidMotion, after: &RigidMotion) -> f64 {
    let (turn, step) = (after.rotation - before.rotation, after.translation - before.translation);
    let squared = |&p: &Point| (turn * Vector3::from(p) + step).norm_squared();
    points.iter().map(squared).fold(0.0, f64::max).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::vector::squared_distance;
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn motions_compose_and_survive_their_matrix(
            a in prop::array::uniform3(-3.0f64..3.0), b in prop::array::uniform3(-3.0f64..3.0),
            x in prop::array::uniform3(-5.0f64..5.0),
        ) {
            let motion = |w: Point| RigidMotion {
                rotation: Rotation3::new(Vector3::from(w)).into_inner(),
                translation: Vector3::new(w[2], w[0], w[1]),
            };
            let (first, second) = (motion(a), motion(b));
            let both = second.after(&first);
            prop_assert!(squared_distance(both.apply(x), second.apply(first.apply(x))).sqrt() < 1e-13);
            prop_assert_eq!(RigidMotion::from_rows(&both.to_rows()).unwrap(), both);
        }
    }

    #[test]
    fn a_change_of_motion_moves_the_farthest_point_most() {
        let turn = |angle| Rotation3::new(Vector3::new(0.0, 0.0, angle)).into_inner();
        let motion = |angle, x| RigidMotion { rotation: turn(angle), translation: Vector3::new(x, 0.0, 0.0) };
        let (before, after) = (motion(0.2, 0.5), motion(0.3, 0.6));
        let points = [[0.1, 0.0, 7.0], [2.0, 1.0, 0.0], [-0.5, 0.3, 1.0]];
        let shifts = points.map(|p| squared_distance(before.apply(p), after.apply(p)).sqrt());
        let most = shifts.into_iter().fold(0.0, f64::max);
        assert!((measure_shift(&points, &before, &after) - most).abs() < 1e-12);
        assert_eq!(measure_shift(&[], &before, &after), 0.0);
    }

    #[test]
    fn composing_makes_rotations_orthonormal_again() {
        let mut rows = RigidMotion::identity().to_rows();
        (rows[0][1], rows[1][0]) = (4e-7, 3e-7);
        let mut motion = RigidMotion::from_rows(&rows).unwrap();
        let turn = Rotation3::new(Vector3::new(0.1, -0.2, 0.3)).into_inner();
        let step = RigidMotion { rotation: turn, translation: Vector3::zeros() };
        for _ in 0..10_000 {
            motion = step.after(&motion);
        }
        let off = motion.rotation * motion.rotation.transpose() - Matrix3::identity();
        assert!(off.amax() < 1e-14, "{off}");
    }

    #[test]
    fn a_matrix_that_is_no_rigid_motion_is_refused() {
        let good = RigidMotion::identity().to_rows();
        let spoil = |i: usize, j: usize, value: f64| {
            let mut rows = good;
            rows[i][j] = value;
            RigidMotion::from_rows(&rows)
        };
        assert!(RigidMotion::from_rows(&good).is_ok());
        assert!(spoil(0, 0, -1.0).is_err(), "a mirror");
        assert!(spoil(1, 1, 1.1).is_err(), "a scale");
        assert!(spoil(0, 1, 0.1).is_err(), "a shear");
        assert!(spoil(3, 0, 0.1).is_err(), "a projective row");
        assert!(spoil(0, 3, f64::NAN).is_err(), "NaN");
    }
}
