//! One kernel on one cloud, for profiles and instruction counts: `once KERNEL POINTS TIMES [THREADS]`.
//!
//! Prints the least time of all runs, milliseconds. With 0 times it only makes the cloud and prints nothing.

mod random;

use std::f64::consts::{PI, TAU};
use std::hint::black_box;
use std::time::Instant;

use nalgebra::Vector3;
use strand::{
    DepthView, IcpOptions, Neighbors, Objective, Pinhole, Point, Residual, RigidMotion, Spline, Tube,
    TubeFitOptions, TubeView, Viewpoints, centerline, crop_images, estimate_normals, fit_tubes, icp,
    radius_outlier_mask, trace_chains, trace_tubes,
};

use random::generator;

const RADIUS: f64 = 0.0042; // radius of the rope, metres
const SPACING: f64 = 0.0004; // distance between points of its surface, metres

/// Makes the upper side of a rope in a wave on a table, with noise of about 0.3 mm, in order along it.
fn rope(count: usize, mut random: impl FnMut() -> f64) -> Vec<Point> {
    let across = (PI * RADIUS / SPACING).round() as usize;
    let wave = TAU / 0.5;
    (0..count)
        .map(|i| {
            let x = ((i / across) as f64 + random()) * SPACING;
            let angle = ((i % across) as f64 + random()) * PI / across as f64;
            let side = Vector3::new(-0.05 * wave * (wave * x).cos(), 1.0, 0.0).normalize();
            let outward = side * angle.cos() + Vector3::z() * angle.sin();
            let noise = Vector3::from_fn(|_, _| 6e-4 * (random() + random() + random() - 1.5));
            (Vector3::new(x, 0.05 * (wave * x).sin(), 0.0) + outward * RADIUS + noise).into()
        })
        .collect()
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, kernel, count, times, threads @ ..] = arguments.as_slice() else {
        panic!("once KERNEL POINTS TIMES [THREADS]")
    };
    let count = count.parse().expect("a number of points");
    if let [threads] = threads {
        strand::set_num_threads(threads.parse().expect("a number of threads"));
    }
    let points = rope(count, generator(1));
    let above = Viewpoints::One([0.0, 0.0, 1.0]);
    let near = Neighbors::Within(RADIUS / 2.0);
    let run: Box<dyn Fn()> = match kernel.as_str() {
        "filter" => Box::new(|| drop(black_box(radius_outlier_mask(&points, RADIUS / 2.0, 45)))),
        "nearest" => Box::new(|| drop(black_box(estimate_normals(&points, Neighbors::Nearest(16), above)))),
        "within" => Box::new(|| drop(black_box(estimate_normals(&points, near, above)))),
        "icp" => {
            let turn = nalgebra::Rotation3::new(Vector3::new(0.035, 0.0, 0.0)).into_inner();
            let off = RigidMotion { rotation: turn, translation: Vector3::new(3e-4, 5e-4, -4e-4) };
            let source: Vec<Point> = rope(count, generator(2)).into_iter().map(|p| off.apply(p)).collect();
            let options = IcpOptions {
                start: RigidMotion::identity(),
                max_correspondence_distance: RADIUS / 2.0,
                max_iterations: 20,
                tolerance: 0.0,
            };
            let points = &points;
            Box::new(move || {
                black_box(icp(&source, points, Objective::PointToPoint, &options)).expect("a registration");
            })
        }
        "centerline" => {
            let normals = estimate_normals(&points, near, above).expect("normals").normals;
            let points = &points;
            Box::new(move || drop(black_box(centerline(points, &normals, RADIUS, 20))))
        }
        "chains" => {
            let normals = estimate_normals(&points, near, above).expect("normals").normals;
            let axis = centerline(&points, &normals, RADIUS, 20).expect("axis points").points;
            Box::new(move || drop(black_box(trace_chains(&axis, RADIUS, 2.5 * RADIUS, None))))
        }
        "tubes" => Box::new(|| drop(black_box(trace_tubes(&points, above, RADIUS, 4)))),
        "fit" => {
            let views = [TubeView {
                points: &points,
                viewpoint: [0.0, 0.0, 1.0],
                end_observations: &[],
                foot_points: &[],
            }];
            let axis: Vec<Point> = points.chunks(200).map(|some| some[some.len() / 2]).collect();
            let curve = Spline::through(&axis, 2.5 * RADIUS, 0.0).expect("a curve");
            let tubes = [Tube { curve, radius_class: 0 }];
            let options = TubeFitOptions {
                residual: Residual::Ray,
                pose_sd: [0.01, 0.002],
                iterations: 5,
                tolerance: 1e-9,
                ..TubeFitOptions::default()
            };
            Box::new(move || {
                let still = [RigidMotion::identity()];
                black_box(fit_tubes(&views, &tubes, &still, &[RADIUS], &options)).expect("a fit");
            })
        }
        "crop" => {
            let depth: Vec<f64> = points.iter().map(|p| 1.0 - p[2]).collect();
            let camera = Pinhole { focal: [250.0; 2], center: [100.0, 50.0] };
            let range = [[-0.2, -0.2, 1.0 - RADIUS], [0.2, 0.2, 1.0]];
            Box::new(move || {
                let view = DepthView { depth: &depth, width: 200, camera, pose: RigidMotion::identity() };
                drop(black_box(crop_images(&[view], range)));
            })
        }
        other => panic!("{other} is none of the kernels"),
    };
    let timed = |_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64() * 1e3
    };
    let times = (0..times.parse::<usize>().expect("a number of times")).map(timed);
    if let Some(least) = times.reduce(f64::min) {
        println!("{kernel} {count}: {least:.2} ms");
    }
}
