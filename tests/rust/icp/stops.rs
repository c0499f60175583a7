//! When registration stops and when it keeps the start pose; which arguments it refuses.

use super::{apart, options};
use crate::fixtures::{FAR_AWAY, Random, hills, inverse, motion, moved, scaled, shifted, tube};
use nalgebra::Vector3;
use strand::{Error, IcpOptions, IcpResult, Objective, Point, RigidMotion, Stop, icp};

#[test]
fn the_iteration_limit_ends_it() {
    let (target, _) = hills(500, 41);
    let source = moved(&target, &motion([0.05, 0.0, 0.02], [0.03, 0.0, 0.0]));
    let mut last = f64::INFINITY;
    for max_iterations in 0..4 {
        let limits = IcpOptions { max_iterations, tolerance: 0.0, ..options(0.5) };
        let found = icp(&source, &target, Objective::PointToPoint, &limits).unwrap();
        assert_eq!(
            (found.iterations, found.stop, found.converged),
            (max_iterations, Stop::Iterations, false)
        );
        assert!(found.inlier_rmse < last, "every step of point-to-point lowers it while all are paired");
        last = found.inlier_rmse;
        if max_iterations == 0 {
            assert_eq!(found.transformation, RigidMotion::identity());
        }
    }
}

#[test]
fn it_ends_at_the_first_update_that_changes_little() {
    let (target, _) = hills(800, 43);
    let (source, _) = hills(500, 44);
    for (reach, tolerance) in [(0.05, 1e-2), (0.05, 1e-3), (0.25, 3e-3), (0.25, 1e-3), (0.25, 3e-4)] {
        let limits = IcpOptions { tolerance: 0.0, ..options(reach) };
        let course: Vec<IcpResult> = (0..30)
            .map(|max_iterations| IcpOptions { max_iterations, ..limits })
            .map(|limits| icp(&source, &target, Objective::PointToPoint, &limits).unwrap())
            .collect();
        let little = |pair: &[IcpResult]| {
            (pair[1].fitness - pair[0].fitness).abs() <= tolerance
                && (pair[1].inlier_rmse - pair[0].inlier_rmse).abs() <= tolerance * reach
        };
        let first = 1 + course.windows(2).position(little).unwrap();
        let limits = IcpOptions { tolerance, ..limits };
        let found = icp(&source, &target, Objective::PointToPoint, &limits).unwrap();
        assert_eq!((found.iterations, found.stop, found.converged), (first, Stop::Tolerance, true));
        assert_eq!(found.transformation, course[first].transformation);
    }
}

#[test]
fn flat_clouds_are_turned_and_never_mirrored() {
    let mut random = Random(45);
    for _ in 0..40 {
        let flat: Vec<Point> = (0..200).map(|_| random.point()).map(|p| [p[0], p[1], 0.0]).collect();
        let target = moved(&flat, &motion(random.point(), random.point()));
        let truth = motion([0.01, 0.02, -0.03], [0.01, -0.02, 0.01]);
        let source = moved(&target, &inverse(&truth));
        let found = icp(&source, &target, Objective::PointToPoint, &options(0.5)).unwrap();
        assert!(found.transformation.rotation.determinant() > 0.0);
        assert!(apart(&source, &found.transformation, &truth) < 1e-12);
    }
}

#[test]
fn a_wide_tolerance_ends_it_after_one_update() {
    let (target, _) = hills(500, 42);
    let source = shifted(&target, [0.05, 0.0, 0.0]);
    let limits = IcpOptions { tolerance: 1.0, ..options(0.5) };
    let found = icp(&source, &target, Objective::PointToPoint, &limits).unwrap();
    assert_eq!((found.iterations, found.stop, found.converged), (1, Stop::Tolerance, true));
}

/// Asserts that nothing moved, and why.
fn assert_kept(found: &IcpResult, start: &RigidMotion, stop: Stop) {
    assert_eq!((found.stop, found.iterations, found.converged), (stop, 0, false));
    assert_eq!(found.transformation, *start);
}

#[test]
fn too_few_pairs_keep_the_start() {
    let (target, normals) = hills(50, 51);
    let start = motion([0.1, 0.2, 0.3], [0.0, 0.0, 100.0]);
    let limits = IcpOptions { start, ..options(0.5) };
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&normals)] {
        let found = icp(&target, &target, objective, &limits).unwrap();
        assert_kept(&found, &start, Stop::TooFewCorrespondences);
        assert_eq!((found.fitness, found.inlier_rmse), (0.0, 0.0));
    }
    let identity = RigidMotion::identity();
    let two = icp(&target[..2], &target, Objective::PointToPoint, &options(0.5)).unwrap();
    assert_kept(&two, &identity, Stop::TooFewCorrespondences);
    assert_eq!(two.fitness, 1.0);
    let five = icp(&target[..5], &target, Objective::PointToPlane(&normals), &options(0.5)).unwrap();
    assert_kept(&five, &identity, Stop::TooFewCorrespondences);
    assert!(icp(&target[..3], &target, Objective::PointToPoint, &options(0.5)).unwrap().converged);
}

#[test]
fn points_on_a_line_or_in_one_place_leave_the_pose_open() {
    let mut random = Random(61);
    let identity = RigidMotion::identity();
    for origin in [[0.0; 3], FAR_AWAY] {
        for _ in 0..20 {
            let direction = Vector3::from(random.point());
            let line: Vec<Point> =
                (0..50).map(|i| (Vector3::from(origin) + direction * (0.1 * f64::from(i))).into()).collect();
            let source = shifted(&line, [0.01, 0.02, -0.01]);
            let found = icp(&source, &line, Objective::PointToPoint, &options(1.0)).unwrap();
            assert_kept(&found, &identity, Stop::Degenerate);
        }
    }
    let one = [[0.25, -1.0, 3.0]; 10];
    let found = icp(&shifted(&one, [0.1, 0.0, 0.0]), &one, Objective::PointToPoint, &options(1.0)).unwrap();
    assert_kept(&found, &identity, Stop::Degenerate);
    // all are nearest to one target point
    let corner = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]];
    let around = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.1, 0.1, 0.1]];
    let found = icp(&around, &corner, Objective::PointToPoint, &options(1.0)).unwrap();
    assert_kept(&found, &identity, Stop::Degenerate);
}

#[test]
fn planes_that_let_the_pose_slide_leave_it_open() {
    let mut random = Random(71);
    let plane: Vec<Point> = (0..1000).map(|_| random.point()).map(|p| [p[0], p[1], 0.0]).collect();
    let up = vec![[0.0, 0.0, 1.0]; plane.len()];
    let (tube, tube_normals) = tube(1000, 30.0, 72);
    let sphere: Vec<Point> = (0..1000).map(|_| Vector3::from(random.point()).normalize().into()).collect();
    for _ in 0..100 {
        let tilt = motion(scaled(&[random.point()], 2.0)[0], random.point());
        let turn = RigidMotion { translation: Vector3::zeros(), ..tilt };
        for (shape, normals) in [(&plane, &up), (&tube, &tube_normals), (&sphere, &sphere)] {
            for origin in [[0.0; 3], FAR_AWAY] {
                let target = shifted(&moved(shape, &tilt), origin);
                let normals = moved(normals, &turn);
                let found = icp(&target, &target, Objective::PointToPlane(&normals), &options(0.5)).unwrap();
                assert_kept(&found, &RigidMotion::identity(), Stop::Degenerate);
            }
        }
    }
    let nothing = vec![[0.0; 3]; plane.len()];
    let found = icp(&plane, &plane, Objective::PointToPlane(&nothing), &options(0.5)).unwrap();
    assert_kept(&found, &RigidMotion::identity(), Stop::Degenerate);
}

/// Returns the name of the refused argument.
fn refused(source: &[Point], target: &[Point], objective: Objective, options: &IcpOptions) -> &'static str {
    match icp(source, target, objective, options) {
        Err(Error::InvalidArgument { name, .. } | Error::NotEnoughData { name, .. }) => name,
        other => panic!("{other:?}"),
    }
}

#[test]
fn wrong_arguments_are_named() {
    let (points, normals) = hills(20, 1);
    let to_points = Objective::PointToPoint;
    for bad in [f64::NAN, f64::INFINITY, 1e100] {
        let spoilt = vec![[0.0, bad, 0.0]; 20];
        assert_eq!(refused(&spoilt, &points, to_points, &options(1.0)), "source");
        assert_eq!(refused(&points, &spoilt, to_points, &options(1.0)), "target");
        let planes = Objective::PointToPlane(&spoilt);
        assert_eq!(refused(&points, &points, planes, &options(1.0)), "target_normals");
    }
    for length in [0.9, 1.1, 1e-3, 1e99] {
        let planes = scaled(&normals, length);
        let planes = Objective::PointToPlane(&planes);
        assert_eq!(refused(&points, &points, planes, &options(1.0)), "target_normals");
    }
    let planes = Objective::PointToPlane(&normals[..19]);
    assert_eq!(refused(&points, &points, planes, &options(1.0)), "target_normals");
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(&points, &points, to_points, &options(bad)), "max_correspondence_distance");
    }
    let unset = IcpOptions::default();
    assert_eq!(refused(&points, &points, to_points, &unset), "max_correspondence_distance");
    for tolerance in [-1e-9, f64::NAN] {
        let limits = IcpOptions { tolerance, ..options(1.0) };
        assert_eq!(refused(&points, &points, to_points, &limits), "tolerance");
    }
    for (source, target, name) in [(&points[..0], &points[..], "source"), (&points, &points[..0], "target")] {
        let error = icp(source, target, to_points, &options(1.0)).unwrap_err();
        assert!(matches!(error, Error::NotEnoughData { name: named, .. } if named == name), "{error}");
    }
}
