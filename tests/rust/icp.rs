//! Registration against brute force and against known motions.

use crate::fixtures::{
    FAR_AWAY, any_motion, cases, distance, free_cloud, hills, inverse, motion, moved, order, reordered,
    scaled, shifted,
};
use nalgebra::{DMatrix, DVector, Matrix4, Quaternion, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};
use proptest::prelude::*;
use strand::{IcpOptions, IcpResult, Objective, Point, RigidMotion, Stop, icp, register_in_turn};

mod stops;

pub fn options(reach: f64) -> IcpOptions {
    IcpOptions {
        start: RigidMotion::identity(),
        max_correspondence_distance: reach,
        max_iterations: 50,
        tolerance: 1e-12,
    }
}

fn small_motion() -> impl Strategy<Value = RigidMotion> {
    (prop::array::uniform3(-0.04f64..0.04), prop::array::uniform3(-0.03f64..0.03))
        .prop_map(|(w, t)| motion(w, t))
}

/// Returns the largest distance between the points as two motions move them.
pub fn apart(points: &[Point], a: &RigidMotion, b: &RigidMotion) -> f64 {
    points.iter().map(|&p| distance(a.apply(p), b.apply(p))).fold(0.0, f64::max)
}

/// Pairs moved source points with their nearest target points within reach; also returns the share of points with a
/// pair and the root mean square distance.
fn paired(
    source: &[Point],
    target: &[Point],
    pose: &RigidMotion,
    reach: f64,
) -> (Vec<(Point, usize)>, f64, f64) {
    let pairs: Vec<(Point, usize)> = source
        .iter()
        .map(|&x| pose.apply(x))
        .filter_map(|x| {
            let nearest = (0..target.len())
                .min_by(|&i, &j| distance(target[i], x).total_cmp(&distance(target[j], x)))?;
            (distance(target[nearest], x) <= reach).then_some((x, nearest))
        })
        .collect();
    let squares: f64 = pairs.iter().map(|&(x, i)| distance(x, target[i]).powi(2)).sum();
    let count = pairs.len() as f64;
    let rmse = if pairs.is_empty() { 0.0 } else { (squares / count).sqrt() };
    (pairs, count / source.len() as f64, rmse)
}

fn mean(points: impl ExactSizeIterator<Item = Point>) -> Vector3<f64> {
    let count = points.len() as f64;
    points.map(Vector3::from).sum::<Vector3<f64>>() / count
}

/// Solves for the motion of least squares between paired points by unit quaternions (Horn 1987).
fn step_to_points(pairs: &[(Point, usize)], target: &[Point]) -> RigidMotion {
    let from = mean(pairs.iter().map(|pair| pair.0));
    let to = mean(pairs.iter().map(|pair| target[pair.1]));
    let mut n = Matrix4::<f64>::zeros();
    for &(x, i) in pairs {
        let (a, b) = (Vector3::from(x) - from, Vector3::from(target[i]) - to);
        let left = Matrix4::new(
            0.0, -a.x, -a.y, -a.z, a.x, 0.0, a.z, -a.y, a.y, -a.z, 0.0, a.x, a.z, a.y, -a.x, 0.0,
        );
        let right = Matrix4::new(
            0.0, -b.x, -b.y, -b.z, b.x, 0.0, -b.z, b.y, b.y, b.z, 0.0, -b.x, b.z, -b.y, b.x, 0.0,
        );
        n += left.transpose() * right;
    }
    let eigen = SymmetricEigen::try_new(n, f64::EPSILON, 1000).unwrap();
    let q = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
    let rotation = rotation.to_rotation_matrix().into_inner();
    RigidMotion { rotation, translation: to - rotation * from }
}

/// Solves for the motion of least squares of linearised distances to planes, by the singular value decomposition.
fn step_to_planes(pairs: &[(Point, usize)], target: &[Point], normals: &[Point]) -> RigidMotion {
    let center = mean(pairs.iter().map(|pair| pair.0));
    let equations = DMatrix::from_fn(pairs.len(), 6, |row, column| {
        let (x, i) = pairs[row];
        let n = Vector3::from(normals[i]);
        if column < 3 { (Vector3::from(x) - center).cross(&n)[column] } else { n[column - 3] }
    });
    let right = DVector::from_fn(pairs.len(), |row, _| {
        let (x, i) = pairs[row];
        (Vector3::from(target[i]) - Vector3::from(x)).dot(&Vector3::from(normals[i]))
    });
    let solved = equations.svd(true, true).solve(&right, 1e-14).unwrap();
    let turn = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * angle);
    let rotation =
        (turn(Vector3::z(), solved[2]) * turn(Vector3::y(), solved[1]) * turn(Vector3::x(), solved[0]))
            .into_inner();
    let shift = Vector3::new(solved[3], solved[4], solved[5]);
    RigidMotion { rotation, translation: center + shift - rotation * center }
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn every_iteration_is_that_of_brute_force(
        source in free_cloud(30, 120), target in free_cloud(30, 120), start in small_motion(),
        reach in 0.4f64..1.0, by_planes: bool,
    ) {
        let upwards = |p: &Point| (Vector3::from(*p) + Vector3::new(0.1, 0.2, 2.0)).normalize().into();
        let normals: Vec<Point> = target.iter().map(upwards).collect();
        let objective = if by_planes { Objective::PointToPlane(&normals) } else { Objective::PointToPoint };
        let mut pose = start;
        for iterations in 0..4 {
            let (pairs, fitness, rmse) = paired(&source, &target, &pose, reach);
            let limits = IcpOptions { start, max_iterations: iterations, tolerance: 0.0, ..options(reach) };
            let found = icp(&source, &target, objective, &limits).unwrap();
            // unless the pose repeats to the last bit
            prop_assert!(found.iterations == iterations || found.stop == Stop::Tolerance);
            prop_assert!(apart(&source, &found.transformation, &pose) < 1e-9);
            prop_assert!((found.fitness - fitness).abs() < 1e-12);
            prop_assert!((found.inlier_rmse - rmse).abs() < 1e-9);
            if pairs.len() < 12 {
                break;
            }
            let step = match by_planes {
                true => step_to_planes(&pairs, &target, &normals),
                false => step_to_points(&pairs, &target),
            };
            pose = RigidMotion {
                rotation: step.rotation * pose.rotation,
                translation: step.rotation * pose.translation + step.translation,
            };
        }
    }

    #[test]
    fn known_motions_are_recovered(truth in small_motion(), by_planes: bool, far: bool, seed: u64) {
        let (local, normals) = hills(600, seed);
        let target = if far { shifted(&local, FAR_AWAY) } else { local };
        // a small turn about the cloud's own place
        let center = if far { FAR_AWAY } else { [0.0; 3] };
        let shift = Vector3::from(center) - truth.rotation * Vector3::from(center) + truth.translation;
        let truth = RigidMotion { translation: shift, ..truth };
        let source = moved(&target, &inverse(&truth));
        let objective = if by_planes { Objective::PointToPlane(&normals) } else { Objective::PointToPoint };
        // coordinates of 3e5 m have a resolution of 6e-11 m
        let lost = if far { 1e-9 } else { 1e-12 };
        let limits = IcpOptions { max_iterations: 200, tolerance: lost, ..options(0.5) };
        let found = icp(&source, &target, objective, &limits).unwrap();
        prop_assert!(found.converged && found.stop == Stop::Tolerance, "{found:?}");
        prop_assert!(apart(&source, &found.transformation, &truth) < lost);
        prop_assert_eq!(found.fitness, 1.0);
        prop_assert!(found.inlier_rmse < lost);
    }

    #[test]
    fn the_frame_the_order_and_the_unit_do_not_matter(
        truth in small_motion(), frame in any_motion(), by_planes: bool, seed: u64,
    ) {
        let (target, normals) = hills(300, seed);
        let (other, _) = hills(200, seed ^ 1);
        let source = moved(&other, &inverse(&truth));
        let limits = IcpOptions { max_iterations: 5, tolerance: 0.0, ..options(0.3) };
        let run = |source: &[Point], target: &[Point], normals: &[Point], limits: &IcpOptions| {
            let planes = Objective::PointToPlane(normals);
            let objective = if by_planes { planes } else { Objective::PointToPoint };
            icp(source, target, objective, limits).unwrap()
        };
        let found = run(&source, &target, &normals, &limits);
        let same = |other: &IcpResult, pose: &RigidMotion, unit: f64| {
            apart(&source, pose, &found.transformation) < 1e-9
                && other.fitness == found.fitness
                && (other.inlier_rmse / unit - found.inlier_rmse).abs() < 1e-9
        };

        let (of_source, of_target) = (order(seed, source.len()), order(seed ^ 2, target.len()));
        let shuffled = run(
            &reordered(&source, &of_source),
            &reordered(&target, &of_target),
            &reordered(&normals, &of_target),
            &limits,
        );
        prop_assert!(same(&shuffled, &shuffled.transformation, 1.0));

        let unit = 1e-3;
        let reach = limits.max_correspondence_distance * unit;
        let small = run(
            &scaled(&source, unit), &scaled(&target, unit), &normals,
            &IcpOptions { max_correspondence_distance: reach, ..limits },
        );
        let translation = small.transformation.translation / unit;
        let pose = RigidMotion { translation, ..small.transformation };
        prop_assert!(same(&small, &pose, unit));

        // the angles of a point-to-plane step are about the frame's axes, so only its limit is equal in all frames
        if !by_planes {
            let turned = run(&moved(&source, &frame), &moved(&target, &frame), &normals, &limits);
            let pose = inverse(&frame).after(&turned.transformation.after(&frame));
            prop_assert!(same(&turned, &pose, 1.0));
        }
    }
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    let (target, normals) = hills(3000, 21);
    let (other, _) = hills(2000, 22);
    let source = moved(&other, &motion([0.02, -0.01, 0.03], [0.01, 0.02, -0.01]));
    // rounded to the resolution of far coordinates, so that both clouds are exactly equal
    let rounded = |points: &[Point]| -> Vec<Point> {
        points.iter().map(|p| p.map(|x| (x * 2f64.powi(30)).round() / 2f64.powi(30))).collect()
    };
    let (source, target) = (rounded(&source), rounded(&target));
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&normals)] {
        let limits = IcpOptions { max_iterations: 10, tolerance: 0.0, ..options(0.2) };
        let near = icp(&source, &target, objective, &limits).unwrap();
        let far = icp(&shifted(&source, FAR_AWAY), &shifted(&target, FAR_AWAY), objective, &limits).unwrap();
        let moved_back: Vec<Point> = shifted(&source, FAR_AWAY)
            .iter()
            .map(|&x| std::array::from_fn(|k| far.transformation.apply(x)[k] - FAR_AWAY[k]))
            .collect();
        let lost = source
            .iter()
            .zip(&moved_back)
            .map(|(&x, &y)| distance(near.transformation.apply(x), y))
            .fold(0.0, f64::max);
        assert!(lost < 4e-10, "{lost:e} m");
        assert_eq!(near.fitness, far.fitness);
        assert!((near.inlier_rmse - far.inlier_rmse).abs() < 1e-9);
    }
}

#[test]
fn units_far_from_metres_do_not_matter() {
    let (target, normals) = hills(300, 23);
    let source = moved(&target, &motion([0.02, -0.01, 0.03], [0.01, 0.02, -0.01]));
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&normals)] {
        let limits = IcpOptions { max_iterations: 3, tolerance: 0.0, ..options(0.3) };
        let expected = icp(&source, &target, objective, &limits).unwrap();
        for unit in [1e-70, 1e-30, 1e30, 1e98] {
            let limits = IcpOptions { max_correspondence_distance: 0.3 * unit, ..limits };
            let found = icp(&scaled(&source, unit), &scaled(&target, unit), objective, &limits).unwrap();
            let translation = found.transformation.translation / unit;
            let found = RigidMotion { translation, ..found.transformation };
            assert!(apart(&source, &found, &expected.transformation) < 1e-9, "unit {unit:e}");
        }
    }
}

#[test]
fn the_start_pose_counts() {
    let (target, normals) = hills(1000, 31);
    let truth = motion([2.0, 0.5, -1.0], [3.0, -4.0, 1.0]);
    let source = moved(&target, &inverse(&truth));
    let close = motion([0.02, 0.01, -0.02], [0.02, -0.01, 0.01]).after(&truth);
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&normals)] {
        let limits = IcpOptions { start: close, max_iterations: 100, ..options(0.3) };
        let found = icp(&source, &target, objective, &limits).unwrap();
        assert!(found.converged && apart(&source, &found.transformation, &truth) < 1e-10, "{found:?}");
        let exact = IcpOptions { start: truth, ..limits };
        let found = icp(&source, &target, objective, &exact).unwrap();
        assert_eq!((found.iterations, found.stop), (1, Stop::Tolerance));
    }
}

#[test]
fn coincident_points_are_no_trouble() {
    let (mut target, _) = hills(200, 81);
    target.extend_from_slice(&target.clone());
    target.extend(vec![target[0]; 300]);
    let truth = motion([0.01, 0.02, -0.01], [0.01, 0.0, 0.01]);
    let source = moved(&target, &inverse(&truth));
    let found = icp(&source, &target, Objective::PointToPoint, &options(0.5)).unwrap();
    assert!(found.converged && apart(&source, &found.transformation, &truth) < 1e-12);
}

#[test]
fn a_pair_as_far_apart_as_the_limit_counts() {
    let target = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 0.0, 8.0]];
    let source = shifted(&target, [0.75, 0.0, 0.0]);
    let limits = IcpOptions { max_iterations: 0, ..options(0.75) };
    let found = icp(&source, &target, Objective::PointToPoint, &limits).unwrap();
    assert_eq!((found.fitness, found.inlier_rmse), (1.0, 0.75));
    let limits = IcpOptions { max_correspondence_distance: 0.75 * (1.0 - 1e-15), ..limits };
    assert_eq!(icp(&source, &target, Objective::PointToPoint, &limits).unwrap().fitness, 0.0);
}

#[test]
fn pairs_that_are_kept_from_pose_to_pose_are_those_of_a_new_search() {
    let (sparse, _) = hills(300, 93);
    let (mut dense, _) = hills(3000, 94);
    // more coincident points than are kept of a point's surroundings
    dense.extend(vec![dense[7]; 20]);
    // more points than stay in the cache of a core
    let (large, _) = hills(9000, 96);
    for (source, target) in [(&sparse, &dense), (&dense, &sparse), (&large, &dense)] {
        // many points have no partner in reach, and gain or lose one during the iterations
        for reach in [0.03, 0.3] {
            let limits =
                IcpOptions { start: motion([0.02, -0.03, 0.02], [0.05, 0.04, 0.02]), ..options(reach) };
            let all = IcpOptions { max_iterations: 25, tolerance: 0.0, ..limits };
            let kept = icp(source, target, Objective::PointToPoint, &all).unwrap();
            let mut step = kept;
            let mut one = IcpOptions { max_iterations: 1, tolerance: 0.0, ..limits };
            for _ in 0..kept.iterations {
                step = icp(source, target, Objective::PointToPoint, &one).unwrap();
                one.start = step.transformation;
            }
            assert!(apart(source, &kept.transformation, &step.transformation) < 1e-11);
            assert_eq!(kept.fitness, step.fitness);
        }
    }
}

#[test]
fn clouds_in_turn_are_each_registered_to_all_before() {
    let (points, _) = hills(600, 95);
    let motions =
        [motion([0.01, 0.0, -0.01], [0.01, 0.02, 0.0]), motion([0.0, -0.01, 0.01], [0.0, -0.01, 0.02])];
    let clouds = [points.clone(), moved(&points, &motions[0]), moved(&points, &motions[1])];
    let found = register_in_turn(&clouds.each_ref().map(Vec::as_slice), &options(0.5)).unwrap();
    assert_eq!(found.len(), 2);
    for (found, true_motion) in found.iter().zip(&motions) {
        assert!(apart(&clouds[1], &found.transformation, &inverse(true_motion)) < 1e-9);
    }
    assert!(register_in_turn(&[], &options(0.5)).unwrap().is_empty());
}

#[test]
fn many_steps_stay_rigid() {
    let (target, _) = hills(400, 91);
    let (source, _) = hills(400, 92);
    let limits = IcpOptions { max_iterations: 300, tolerance: 0.0, ..options(2.0) };
    let found = icp(&source, &target, Objective::PointToPoint, &limits).unwrap().transformation;
    let off = found.rotation * found.rotation.transpose() - nalgebra::Matrix3::identity();
    assert!(off.amax() < 1e-14 && found.rotation.determinant() > 0.0);
    assert_eq!(RigidMotion::from_rows(&found.to_rows()).unwrap(), found);
}
