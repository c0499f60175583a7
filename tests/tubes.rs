//! Tubes traced and fitted, against simulated half-shells with known axes and poses.

use strand::{
    Error, Point, Residual, RigidMotion, Spline, TubeFitOptions, TubeView, Viewpoints, fit_tubes, trace_tubes,
};

const RADIUS: f64 = 0.004;

/// A wave in the plane z = 0.
fn axis(x: f64) -> (Point, Point) {
    let (height, rate) = (0.02, 25.0);
    let slope = height * rate * (rate * x).cos();
    let length = slope.hypot(1.0);
    ([x, height * (rate * x).sin(), 0.0], [1.0 / length, slope / length, 0.0])
}

/// Points of the tube about the wave that face a camera.
fn half_shell(camera: Point) -> Vec<Point> {
    let mut points = Vec::new();
    for i in 0..700 {
        let (c, t) = axis(-0.14 + 0.0004 * f64::from(i));
        for j in 0..40 {
            let angle = (f64::from(j) + 0.5 * f64::from(i % 2)) * std::f64::consts::TAU / 40.0;
            let outward = [-t[1] * angle.cos(), t[0] * angle.cos(), angle.sin()];
            let p: Point = std::array::from_fn(|k| c[k] + RADIUS * outward[k]);
            if (0..3).map(|k| outward[k] * (camera[k] - p[k])).sum::<f64>() > 0.0 {
                points.push(p);
            }
        }
    }
    points
}

fn distance_from_axis(p: Point) -> f64 {
    let near = |i: i32| {
        let (c, _) = axis(-0.15 + 0.0001 * f64::from(i));
        (0..3).map(|k| (c[k] - p[k]).powi(2)).sum::<f64>()
    };
    (0..3000).map(near).fold(f64::INFINITY, f64::min).sqrt()
}

const CAMERAS: [Point; 3] = [[0.0, -0.4, 0.3], [0.0, 0.0, 0.5], [0.0, 0.4, 0.3]];

fn options() -> TubeFitOptions {
    TubeFitOptions {
        fit_curves: true,
        fit_radius: false,
        reference: Some(1),
        pose_sd: [0.01, 2e-3],
        residual: Residual::Distance,
        band: [0.6, 0.4],
        iterations: 20,
        bounds: None,
        uncertainty: true,
    }
}

#[test]
fn an_arc_runs_along_the_axis() {
    let points = half_shell(CAMERAS[1]);
    let arcs = trace_tubes(&points, Viewpoints::One(CAMERAS[1]), RADIUS, 4).unwrap();
    assert_eq!(arcs.len(), 1);
    assert_eq!(arcs[0].nodes.len(), arcs[0].support.len());
    let inner = &arcs[0].nodes[2..arcs[0].nodes.len() - 2];
    assert!(inner.len() as f64 * 0.5 * RADIUS > 0.28);
    assert!(inner.iter().all(|&node| distance_from_axis(node) < 0.03 * RADIUS));
}

#[test]
fn a_joint_fit_finds_poses_radius_and_axis() {
    let truth = |view: usize| {
        let rows = |a: f64, t: Point| {
            let (s, c) = a.sin_cos();
            [[c, -s, 0.0, t[0]], [s, c, 0.0, t[1]], [0.0, 0.0, 1.0, t[2]], [0.0, 0.0, 0.0, 1.0]]
        };
        let rows = match view {
            0 => rows(0.006, [0.001, -0.0008, 0.0]),
            1 => rows(0.0, [0.0; 3]),
            _ => rows(-0.005, [-0.0007, 0.0009, 0.0]),
        };
        RigidMotion::from_rows(&rows).unwrap()
    };
    // what is reported is off by the motion that the fit has to find
    let clouds: Vec<Vec<Point>> = (0..3)
        .map(|view| {
            let motion = truth(view).to_rows();
            let back = |p: Point| {
                let d: Point = std::array::from_fn(|k| p[k] - motion[k][3]);
                std::array::from_fn(|k| (0..3).map(|i| motion[i][k] * d[i]).sum())
            };
            half_shell(CAMERAS[view]).into_iter().map(back).collect()
        })
        .collect();
    let views: Vec<TubeView> =
        clouds.iter().zip(CAMERAS).map(|(points, viewpoint)| TubeView { points, viewpoint }).collect();
    let nodes: Vec<Point> = (0..70).map(|i| axis(-0.14 + 0.004 * f64::from(i)).0).collect();
    let curve = Spline::through(&nodes, 2.0 * RADIUS, RADIUS).unwrap();
    let still = vec![RigidMotion::identity(); 3];
    let options = TubeFitOptions { fit_radius: true, pose_sd: [0.1, 0.02], ..options() };
    let fit = fit_tubes(&views, &[curve], &still, 1.04 * RADIUS, &options).unwrap();
    assert!((fit.radius / RADIUS - 1.0).abs() < 2e-3, "{}", fit.radius);
    for view in 0..3 {
        for x in [-0.1, 0.0, 0.1] {
            let p = axis(x).0;
            let (found, want) = (fit.motions[view].apply(p), truth(view).apply(p));
            assert!((0..3).all(|k| (found[k] - want[k]).abs() < 1e-4), "view {view}: {found:?} {want:?}");
        }
    }
    let uncertainty = fit.uncertainty.unwrap();
    assert_eq!(uncertainty.poses[1], [0.0; 6]);
    assert!(uncertainty.poses[0].iter().all(|&sd| sd > 0.0));
    assert!(uncertainty.radius > 0.0 && uncertainty.radius < 1e-4);
    for u in fit.curves[0].parameters(RADIUS) {
        assert!(
            distance_from_axis(fit.curves[0].at(u).position) < 0.05 * RADIUS
                || u < 1.0
                || u > fit.curves[0].end() - 1.0
        );
    }
}

#[test]
fn wrong_input_is_refused_by_name() {
    let points = half_shell(CAMERAS[1]);
    let one = Viewpoints::One(CAMERAS[1]);
    let name = |error: Error| error.to_string().split(':').next().unwrap().to_owned();
    assert_eq!(name(trace_tubes(&points, one, 0.0, 4).unwrap_err()), "radius");
    assert_eq!(name(trace_tubes(&[[f64::NAN; 3]], one, RADIUS, 4).unwrap_err()), "points");
    assert_eq!(
        name(trace_tubes(&points, Viewpoints::Each(&points[1..]), RADIUS, 4).unwrap_err()),
        "viewpoint"
    );
    assert!(trace_tubes(&[], one, RADIUS, 4).unwrap().is_empty());
    let nodes: Vec<Point> = (0..70).map(|i| axis(-0.14 + 0.004 * f64::from(i)).0).collect();
    let curve = [Spline::through(&nodes, 2.0 * RADIUS, RADIUS).unwrap()];
    let views = [TubeView { points: &points, viewpoint: CAMERAS[1] }];
    let still = [RigidMotion::identity()];
    let fit = |change: &dyn Fn(&mut TubeFitOptions)| {
        let mut options = TubeFitOptions { reference: Some(0), ..options() };
        change(&mut options);
        fit_tubes(&views, &curve, &still, RADIUS, &options)
    };
    assert!(fit(&|_| {}).is_ok());
    assert_eq!(name(fit(&|o| o.reference = Some(1)).unwrap_err()), "reference");
    assert_eq!(name(fit(&|o| o.pose_sd[1] = 0.0).unwrap_err()), "pose_sd");
    assert_eq!(name(fit(&|o| o.band[0] = -1.0).unwrap_err()), "band");
    assert_eq!(name(fit_tubes(&views, &[], &still, RADIUS, &options()).unwrap_err()), "curves");
    assert_eq!(name(fit_tubes(&views, &curve, &[], RADIUS, &options()).unwrap_err()), "motions");
    assert_eq!(name(Spline::through(&nodes[..1], 0.01, 0.0).unwrap_err()), "nodes");
    assert_eq!(name(Spline::through(&nodes, 0.0, 0.0).unwrap_err()), "spacing");
    assert_eq!(name(Spline::through(&nodes, 0.01, -1.0).unwrap_err()), "extension");
}
