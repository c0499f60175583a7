//! Registration of two clouds by iterated closest points (section IV-C, eq. 15 of *Shape Modeling of A String And
//! Recognition Using Distance Sensor*).

mod options;
mod pairing;

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

use crate::checks::{check_finite, check_normals, check_positive, check_same_length};
use crate::error::{Error, Result};
use crate::geometry::{Point, RigidMotion, dot, sub};
use crate::parallel;
pub use options::IcpOptions;
use pairing::{Pairing, Pairs};

/// The sum that registration minimises.
#[derive(Debug, Clone, Copy)]
pub enum Objective<'a> {
    /// Σ ‖R x_i + t − y_i‖² (eq. 15).
    PointToPoint,
    /// Σ ((R x_i + t − y_i) · n_i)² with the target's unit normals n_i, linearised at the current pose (Chen and
    /// Medioni 1992; R = R_z R_y R_x of the solved angles, as in Low 2004).
    PointToPlane(&'a [Point]),
}

/// Why a registration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// Fitness and inlier RMSE changed by less than the tolerance.
    Tolerance,
    /// The iteration limit was reached.
    Iterations,
    /// Too few correspondences to fix a pose: 3 points, or 6 point-plane pairs.
    TooFewCorrespondences,
    /// The correspondences do not fix the pose: they lie on a line, or their planes let it slide.
    Degenerate,
}

/// The outcome of a registration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IcpResult {
    /// Source frame to target frame.
    pub transformation: RigidMotion,
    /// Share of source points that have a correspondence, 0 to 1.
    pub fitness: f64,
    /// Root mean square distance of the correspondences, metres; 0 if there are none.
    pub inlier_rmse: f64,
    /// Number of updates of the pose.
    pub iterations: usize,
    /// Whether the tolerance was met.
    pub converged: bool,
    /// Why it ended.
    pub stop: Stop,
}

/// Registers `source` to `target` by iterated closest points.
///
/// Each iteration pairs every source point with its nearest target point and solves for the rigid motion. If the data
/// do not fix a pose, the result holds the last sound pose and says why it ended.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, a limit is out of range, or there is not
/// one normal for each target point, of unit length or zero; [`NotEnoughData`](Error::NotEnoughData) if a cloud is
/// empty.
///
/// ```
/// use strand::{IcpOptions, Objective, icp};
/// let target = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let source = target.map(|p| [p[0] + 0.1, p[1], p[2]]);
/// let options = IcpOptions { max_correspondence_distance: 0.5, ..IcpOptions::default() };
/// let found = icp(&source, &target, Objective::PointToPoint, &options)?;
/// assert!(found.converged && (found.transformation.translation.x + 0.1).abs() < 1e-9);
/// # Ok::<(), strand::Error>(())
/// ```
pub fn icp(
    source: &[Point],
    target: &[Point],
    objective: Objective,
    options: &IcpOptions,
) -> Result<IcpResult> {
    check_finite("source", source)?;
    check_finite("target", target)?;
    check_positive("max_correspondence_distance", options.max_correspondence_distance)?;
    if options.tolerance.is_nan() || options.tolerance < 0.0 {
        return Err(Error::invalid(
            "tolerance",
            format!("expected a number >= 0, got {}", options.tolerance),
        ));
    }
    if let Objective::PointToPlane(normals) = objective {
        check_same_length("target_normals", normals.len(), "target points", target.len())?;
        check_normals("target_normals", normals)?;
    }
    for (name, cloud) in [("source", source), ("target", target)] {
        if cloud.is_empty() {
            return Err(Error::not_enough(name, "expected at least one point, got none"));
        }
    }
    Ok(parallel::run(|| {
        let mut pairing = Pairing::new(source, target, options);
        iterate(&mut pairing, objective, options)
    }))
}

/// Registers clouds one after the other (eq. 15).
///
/// The first cloud stays. Each other cloud is registered to all clouds before it, at their registered poses. Returns
/// the results for all clouds but the first.
///
/// # Errors
/// As [`icp`].
pub fn register_in_turn(clouds: &[&[Point]], options: &IcpOptions) -> Result<Vec<IcpResult>> {
    let [first, others @ ..] = clouds else { return Ok(Vec::new()) };
    parallel::run(|| {
        let mut target = first.to_vec();
        let mut results = Vec::with_capacity(others.len());
        for &cloud in others {
            let result = icp(cloud, &target, Objective::PointToPoint, options)?;
            target.extend(cloud.iter().map(|&p| result.transformation.apply(p)));
            results.push(result);
        }
        Ok(results)
    })
}

fn iterate(pairing: &mut Pairing, objective: Objective, options: &IcpOptions) -> IcpResult {
    let mut pose = options.start;
    let mut pairs = pairing.pair(&pose);
    let mut iterations = 0;
    let stop = loop {
        if iterations == options.max_iterations {
            break Stop::Iterations;
        }
        let update = match objective {
            Objective::PointToPoint => solve_points(&pairs),
            Objective::PointToPlane(normals) => solve_planes(pairing, &pairs, normals),
        };
        pose = match update {
            Ok(update) => update.after(&pose),
            Err(stop) => break stop,
        };
        iterations += 1;
        let before = pairs;
        pairs = pairing.pair(&pose);
        if (pairs.fitness() - before.fitness()).abs() <= options.tolerance
            && (pairs.rmse() - before.rmse()).abs() <= options.tolerance * options.max_correspondence_distance
        {
            break Stop::Tolerance;
        }
    };
    IcpResult {
        transformation: pose,
        fitness: pairs.fitness(),
        inlier_rmse: pairs.rmse(),
        iterations,
        converged: stop == Stop::Tolerance,
        stop,
    }
}

/// Solves for the rotation and translation of least squares between paired points, by the singular value decomposition
/// of their cross-covariance (Arun 1987, Umeyama 1991).
fn solve_points(pairs: &Pairs) -> std::result::Result<RigidMotion, Stop> {
    if pairs.count() < 3.0 {
        return Err(Stop::TooFewCorrespondences);
    }
    let (from, to) = pairs.means();
    let covariance = pairs.cross_covariance();
    // scale by the largest entry, so that squares neither overflow nor underflow
    let size = covariance.amax().max(f64::MIN_POSITIVE);
    let svd = (covariance / size).try_svd(true, true, f64::EPSILON, 100).ok_or(Stop::Degenerate)?;
    let (u, v_t) = (svd.u.ok_or(Stop::Degenerate)?, svd.v_t.ok_or(Stop::Degenerate)?);
    // if the points lie on a line, the rotation about it is free
    if svd.singular_values[1] <= 1e-12 * svd.singular_values[0] {
        return Err(Stop::Degenerate);
    }
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    // the means are relative to a point of the cloud, so that no precision is lost far from the origin
    let origin = Vector3::from(pairs.origin);
    Ok(RigidMotion { rotation, translation: (to + origin) - rotation * (from + origin) })
}

/// Takes one Gauss–Newton step of the point-to-plane distance, about the centroid of the paired points.
fn solve_planes(
    pairing: &Pairing,
    pairs: &Pairs,
    normals: &[Point],
) -> std::result::Result<RigidMotion, Stop> {
    if pairs.count() < 6.0 {
        return Err(Stop::TooFewCorrespondences);
    }
    let center = Vector3::from(pairs.origin) + pairs.means().0;
    let system: SMatrix<f64, 6, 7> = pairing.sum(|moved, target, index| {
        let n = Vector3::from(normals[index]);
        let turn = (Vector3::from(moved) - center).cross(&n);
        let residual = dot(sub(moved, target), n.into());
        let jacobian = Vector6::new(turn.x, turn.y, turn.z, n.x, n.y, n.z);
        let mut term = SMatrix::<f64, 6, 7>::zeros();
        term.fixed_columns_mut::<6>(0).copy_from(&(jacobian * jacobian.transpose()));
        term.set_column(6, &(-jacobian * residual));
        term
    });
    let normal_matrix: Matrix6<f64> = system.fixed_columns::<6>(0).into();
    let right: Vector6<f64> = system.column(6).into();
    // scale angles and metres equally, so that small pivots show directions that the data do not fix
    let scale = normal_matrix.diagonal().map(|d| if d > 0.0 { d.sqrt().recip() } else { 0.0 });
    let scaled = normal_matrix.component_mul(&(scale * scale.transpose()));
    let cholesky = scaled.cholesky().ok_or(Stop::Degenerate)?;
    // the terms of a flat wall are equal, and so are their rounding errors: 1e3 of them add up to 1e-6
    if cholesky.l().diagonal().min() < 1e-5 {
        return Err(Stop::Degenerate);
    }
    let x = cholesky.solve(&right.component_mul(&scale)).component_mul(&scale);
    let rotation = nalgebra::Rotation3::from_euler_angles(x[0], x[1], x[2]).into_inner();
    let translation = center + Vector3::new(x[3], x[4], x[5]) - rotation * center;
    Ok(RigidMotion { rotation, translation })
}
