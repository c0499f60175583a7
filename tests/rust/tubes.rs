//! Traced and fitted tubes against simulated half-shells with known axes and poses.

use strand::{
    EndObservation, Error, Point, Residual, RigidMotion, Spline, Tube, TubeFit, TubeFitOptions, TubeView,
    Viewpoints, fit_tubes, trace_tubes,
};

const RADIUS: f64 = 0.004;

/// Returns a point and a direction of a wave in the plane z = 0.
fn axis(x: f64) -> (Point, Point) {
    let (height, rate) = (0.02, 25.0);
    let slope = height * rate * (rate * x).cos();
    let length = slope.hypot(1.0);
    ([x, height * (rate * x).sin(), 0.0], [1.0 / length, slope / length, 0.0])
}

/// Returns points of the tube about the wave that face a camera.
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
    TubeFitOptions { reference: Some(1), pose_sd: [0.01, 2e-3], iterations: 20, ..TubeFitOptions::default() }
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
    // the reported pose is off by the motion that the fit must find
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
    let views: Vec<TubeView> = clouds
        .iter()
        .zip(CAMERAS)
        .map(|(points, viewpoint)| TubeView { points, viewpoint, end_observations: &[], foot_points: &[] })
        .collect();
    let nodes: Vec<Point> = (0..70).map(|i| axis(-0.14 + 0.004 * f64::from(i)).0).collect();
    let curve = Spline::through(&nodes, 2.0 * RADIUS, RADIUS).unwrap();
    let still = vec![RigidMotion::identity(); 3];
    let options = TubeFitOptions {
        radius_prior: Some(vec![[1.04 * RADIUS, RADIUS]]),
        pose_sd: [0.1, 0.02],
        ..options()
    };
    let fit =
        fit_tubes(&views, &[Tube { curve, radius_class: 0 }], &still, &[1.04 * RADIUS], &options).unwrap();
    assert!((fit.radii[0] / RADIUS - 1.0).abs() < 2e-3, "{}", fit.radii[0]);
    for view in 0..3 {
        for x in [-0.1, 0.0, 0.1] {
            let p = axis(x).0;
            let (found, want) = (fit.motions[view].apply(p), truth(view).apply(p));
            assert!((0..3).all(|k| (found[k] - want[k]).abs() < 1e-4), "view {view}: {found:?} {want:?}");
        }
    }
    let uncertainty = fit.uncertainty.unwrap();
    assert_eq!(uncertainty.poses[1], [[0.0; 6]; 6]);
    assert!((0..6).all(|k| uncertainty.poses[0][k][k] > 0.0));
    assert!(uncertainty.radii[0] > 0.0 && uncertainty.radii[0] < 1e-4);
    for u in fit.curves[0].parameters(RADIUS) {
        assert!(
            distance_from_axis(fit.curves[0].at(u).position) < 0.05 * RADIUS
                || u < 1.0
                || u > fit.curves[0].end() - 1.0
        );
    }
}

/// A straight tube along x, seen from above.
fn straight(radius: f64, y: f64) -> Vec<Point> {
    let mut points = Vec::new();
    for i in 0..300 {
        for k in 0..15 {
            let (sin, cos) = (std::f64::consts::PI * (f64::from(k) + 0.5) / 15.0).sin_cos();
            points.push([-0.15 + 0.001 * f64::from(i), y + radius * cos, radius * sin]);
        }
    }
    points
}

#[test]
fn each_class_has_a_radius() {
    let points = [straight(0.003, -0.02), straight(0.006, 0.02)].concat();
    let views =
        [TubeView { points: &points, viewpoint: CAMERAS[1], end_observations: &[], foot_points: &[] }];
    let tube = |y: f64, radius_class: usize| {
        let nodes: Vec<Point> = (0..60).map(|i| [-0.14 + 0.0047 * f64::from(i), y, 0.0]).collect();
        Tube { curve: Spline::through(&nodes, 0.01, 0.0).unwrap(), radius_class }
    };
    let start = [0.0033, 0.0055];
    let options = TubeFitOptions {
        reference: None,
        radius_prior: Some(start.iter().map(|&r| [r, 0.2 * r]).collect()),
        ..options()
    };
    let still = [RigidMotion::identity()];
    let fit = fit_tubes(&views, &[tube(-0.02, 0), tube(0.02, 1)], &still, &start, &options).unwrap();
    assert!((fit.radii[0] / 0.003 - 1.0).abs() < 0.01, "{:?}", fit.radii);
    assert!((fit.radii[1] / 0.006 - 1.0).abs() < 0.01, "{:?}", fit.radii);
    assert!(fit.uncertainty.unwrap().radii.iter().all(|&sd| sd > 0.0 && sd < 1e-4));
    // tubes of one class share its radius
    let same = fit_tubes(&views, &[tube(-0.02, 1), tube(-0.02, 1)], &still, &start, &options).unwrap();
    assert!((same.radii[1] - 0.003).abs() < (same.radii[0] - 0.003).abs());
}

#[test]
fn a_rope_bends_no_tighter_than_it_may() {
    // two straight tubes that meet at an angle of 130 degrees, without a bend between them
    let (sin, cos) = 25f64.to_radians().sin_cos();
    let mut points = Vec::new();
    for i in -500..500 {
        let (s, side) = (2e-4 * f64::from(i), if i < 0 { -1.0 } else { 1.0 });
        for k in 1..12 {
            let (up, across) = (std::f64::consts::PI * f64::from(k) / 12.0).sin_cos();
            let aside = RADIUS * across;
            points.push([s * cos - side * aside * sin, s * side * sin + aside * cos, RADIUS * up]);
        }
    }
    let views =
        [TubeView { points: &points, viewpoint: CAMERAS[1], end_observations: &[], foot_points: &[] }];
    let nodes: Vec<Point> =
        (-30..=30).map(|i| 0.003 * f64::from(i)).map(|s| [s * cos, s.abs() * sin, 0.0]).collect();
    let tubes = [Tube { curve: Spline::through(&nodes, RADIUS, 0.0).unwrap(), radius_class: 0 }];
    let tightest = |min_bend: f64| {
        let options = TubeFitOptions { reference: None, min_bend, iterations: 40, ..options() };
        let fit = fit_tubes(&views, &tubes, &[RigidMotion::identity()], &[RADIUS], &options).unwrap();
        let curve = &fit.curves[0];
        let bend = |three: &[Point]| {
            let norm = |a: Point| a.iter().map(|x| x * x).sum::<f64>().sqrt();
            let second = norm(std::array::from_fn(|k| three[0][k] - 2.0 * three[1][k] + three[2][k]));
            second / (norm(std::array::from_fn(|k| three[2][k] - three[0][k])) / 2.0).powi(2)
        };
        1.0 / (RADIUS * curve.control.windows(3).map(bend).fold(0.0, f64::max))
    };
    assert!(tightest(0.1) < 1.2, "{}", tightest(0.1));
    assert!(tightest(1.5) > 0.95 * 1.5, "{}", tightest(1.5));
}

#[test]
fn deviations_follow_the_noise_that_is_given() {
    let points = half_shell(CAMERAS[1]);
    let views =
        [TubeView { points: &points, viewpoint: CAMERAS[1], end_observations: &[], foot_points: &[] }];
    let nodes: Vec<Point> = (0..70).map(|i| axis(-0.14 + 0.004 * f64::from(i)).0).collect();
    let tubes = [Tube { curve: Spline::through(&nodes, 2.0 * RADIUS, 0.0).unwrap(), radius_class: 0 }];
    let sd = |noise: f64| {
        let options =
            TubeFitOptions { reference: None, residual: Residual::Ray, noise: Some(noise), ..options() };
        let fit = fit_tubes(&views, &tubes, &[RigidMotion::identity()], &[RADIUS], &options).unwrap();
        fit.uncertainty.unwrap().curves[0][10][0][2][2].sqrt()
    };
    assert!((sd(2e-4) / sd(1e-4) - 2.0).abs() < 0.2);
}

#[test]
fn points_that_count_as_one_widen_deviations_and_nothing_else() {
    let points = half_shell(CAMERAS[1]);
    let views =
        [TubeView { points: &points, viewpoint: CAMERAS[1], end_observations: &[], foot_points: &[] }];
    let nodes: Vec<Point> = (0..70).map(|i| axis(-0.14 + 0.004 * f64::from(i)).0).collect();
    let tubes = [Tube { curve: Spline::through(&nodes, 2.0 * RADIUS, 0.0).unwrap(), radius_class: 0 }];
    let fitted = |shared: [f64; 2]| {
        let options = TubeFitOptions {
            reference: None,
            residual: Residual::Ray,
            noise: Some(1e-4),
            shared,
            ..options()
        };
        fit_tubes(&views, &tubes, &[RigidMotion::identity()], &[RADIUS], &options).unwrap()
    };
    let (plain, along, both) = (fitted([1.0; 2]), fitted([9.0, 1.0]), fitted([9.0; 2]));
    for other in [&along, &both] {
        assert_eq!(other.curves, plain.curves);
        assert_eq!(other.foot_points, plain.foot_points);
    }
    let sd = |fit: &TubeFit, direction: Point| {
        let covariance = fit.uncertainty.as_ref().unwrap().curves[0][10][0];
        let pairs = (0..3).flat_map(|i| (0..3).map(move |j| (i, j)));
        pairs.map(|(i, j)| direction[i] * covariance[i][j] * direction[j]).sum::<f64>().sqrt()
    };
    let place = plain.curves[0].at(9.0);
    let unit = |v: Point| v.map(|x| x / v.iter().map(|x| x * x).sum::<f64>().sqrt());
    let t = unit(place.first);
    let ray: Point = std::array::from_fn(|k| CAMERAS[1][k] - place.position[k]);
    let along_curve: f64 = (0..3).map(|k| ray[k] * t[k]).sum();
    let to_camera = unit(std::array::from_fn(|k| ray[k] - along_curve * t[k]));
    let aside = unit(std::array::from_fn(|k| {
        let (a, b) = ((k + 1) % 3, (k + 2) % 3);
        t[a] * to_camera[b] - t[b] * to_camera[a]
    }));
    let ratio = |fit: &TubeFit, direction: Point| sd(fit, direction) / sd(&plain, direction);
    let ratios = [&both, &along].map(|fit| [ratio(fit, to_camera), ratio(fit, aside)]);
    // the prior on the curve acts too
    assert!(ratios[0].iter().all(|ratio| (2.2..3.05).contains(ratio)), "{ratios:?}");
    assert!((2.2..3.05).contains(&ratios[1][0]) && (0.95..1.2).contains(&ratios[1][1]), "{ratios:?}");
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
    let tubes = [Tube { curve: Spline::through(&nodes, 2.0 * RADIUS, RADIUS).unwrap(), radius_class: 0 }];
    let views =
        [TubeView { points: &points, viewpoint: CAMERAS[1], end_observations: &[], foot_points: &[] }];
    let still = [RigidMotion::identity()];
    let fit = |change: &dyn Fn(&mut TubeFitOptions)| {
        let mut options = TubeFitOptions { reference: Some(0), ..options() };
        change(&mut options);
        fit_tubes(&views, &tubes, &still, &[RADIUS], &options)
    };
    assert!(fit(&|_| {}).is_ok());
    assert_eq!(name(fit(&|o| o.reference = Some(1)).unwrap_err()), "reference");
    assert_eq!(name(fit(&|o| o.pose_sd[1] = 0.0).unwrap_err()), "pose_sd");
    assert_eq!(name(fit(&|o| o.band[0] = -1.0).unwrap_err()), "band");
    assert_eq!(name(fit(&|o| o.min_bend = 0.0).unwrap_err()), "min_bend");
    assert_eq!(name(fit(&|o| o.noise = Some(-1.0)).unwrap_err()), "noise");
    assert_eq!(name(fit(&|o| o.radius_prior = Some(vec![])).unwrap_err()), "radius_prior");
    assert_eq!(name(fit(&|o| o.radius_prior = Some(vec![[RADIUS, 0.0]])).unwrap_err()), "radius_prior");
    assert_eq!(name(fit_tubes(&views, &tubes, &still, &[], &options()).unwrap_err()), "radius_classes");
    assert_eq!(name(fit_tubes(&views, &[], &still, &[RADIUS], &options()).unwrap_err()), "curves");
    assert_eq!(name(fit_tubes(&views, &tubes, &[], &[RADIUS], &options()).unwrap_err()), "motions");
    assert_eq!(name(Spline::through(&nodes[..1], 0.01, 0.0).unwrap_err()), "nodes");
    assert_eq!(name(Spline::through(&nodes, 0.0, 0.0).unwrap_err()), "spacing");
    assert_eq!(name(Spline::through(&nodes, 0.01, -1.0).unwrap_err()), "extension");
}

#[test]
fn ends_that_views_see_keep_a_straight_rope_from_sliding() {
    let line: Vec<Point> = (0..80).map(|i| [-0.15 + 0.004 * f64::from(i), 0.0, 0.0]).collect();
    let tube = Tube { curve: Spline::through(&line, 2.0 * RADIUS, 0.0).unwrap(), radius_class: 0 };
    // half-shells of a straight tube; the first view's pose is 3 mm off along it
    let slide = [0.003, 0.0, 0.0];
    let clouds: Vec<Vec<Point>> = CAMERAS
        .iter()
        .enumerate()
        .map(|(view, camera)| {
            let off = if view == 0 { slide } else { [0.0; 3] };
            let mut points = Vec::new();
            for i in 0..600 {
                for j in 0..40 {
                    let angle = f64::from(j) * std::f64::consts::TAU / 40.0;
                    let outward = [0.0, angle.cos(), angle.sin()];
                    let p: Point = std::array::from_fn(|k| {
                        [-0.12 + 0.0004 * f64::from(i), 0.0, 0.0][k] + RADIUS * outward[k]
                    });
                    if (0..3).map(|k| outward[k] * (camera[k] - p[k])).sum::<f64>() > 0.0 {
                        points.push(std::array::from_fn(|k| p[k] + off[k]));
                    }
                }
            }
            points
        })
        .collect();
    let seen_at =
        |x: f64| EndObservation { end: 0, place: [x, 0.0, 0.0], outward: [1.0, 0.0, 0.0], sd: 1e-4 };
    let seen = [vec![seen_at(0.123)], vec![seen_at(0.12)], Vec::new()];
    let fitted = |use_ends: bool| {
        let views: Vec<TubeView> = clouds
            .iter()
            .zip(CAMERAS)
            .zip(&seen)
            .map(|((points, viewpoint), ends)| TubeView {
                points,
                viewpoint,
                end_observations: if use_ends { ends } else { &[] },
                foot_points: &[],
            })
            .collect();
        fit_tubes(
            &views,
            std::slice::from_ref(&tube),
            &vec![RigidMotion::identity(); 3],
            &[RADIUS],
            &options(),
        )
        .unwrap()
    };
    let (with, without) = (fitted(true), fitted(false));
    assert!((with.motions[0].translation[0] + slide[0]).abs() < 1e-4, "{}", with.motions[0].translation[0]);
    assert!(without.motions[0].translation[0].abs() < 1e-4, "{}", without.motions[0].translation[0]);
    // the third view saw no end
    assert!(with.motions[2].translation[0].abs() < 1e-4);
    let sd = |fit: &strand::TubeFit, view: usize| fit.uncertainty.as_ref().unwrap().poses[view][3][3].sqrt();
    assert!(sd(&with, 0) < 2e-4 && sd(&with, 2) > 1e-3 && sd(&without, 0) > 1e-3);
    let twice = [seen_at(0.1), seen_at(0.1)];
    let views =
        [TubeView { points: &clouds[1], viewpoint: CAMERAS[1], end_observations: &twice, foot_points: &[] }];
    let one = TubeFitOptions { reference: None, ..options() };
    assert!(fit_tubes(&views, &[tube], &[RigidMotion::identity()], &[RADIUS], &one).is_err());
}
