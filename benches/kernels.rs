//! Every kernel on a rope's surface: a coiled tube of radius 4.2 mm, with one point on each 0.4 x 0.4 mm.
//!
//! `cargo bench --bench kernels`, or some of it: `cargo bench --bench kernels -- --quick normals/10000`.

mod random;
mod rope;

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use nalgebra::Vector3;
use strand::{
    IcpOptions, Neighbors, Objective, RigidMotion, Viewpoints, centerline, count_neighbors, estimate_normals,
    icp, radius_outlier_mask, trace_chains,
};

use random::generator;
use rope::{RADIUS, Rope};

/// Times a kernel on ropes of 10⁴, 10⁵ and 10⁶ points.
fn bench<T>(criterion: &mut Criterion, name: &str, kernel: impl Fn(&Rope) -> T) {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    group.sampling_mode(SamplingMode::Flat);
    for count in [10_000, 100_000, 1_000_000] {
        let rope = Rope::new(count, generator(1));
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::from_parameter(count), |bencher| {
            bencher.iter(|| kernel(black_box(&rope)));
        });
    }
    group.finish();
}

fn filter(criterion: &mut Criterion) {
    bench(criterion, "radius_outlier_mask", |rope| radius_outlier_mask(&rope.points, RADIUS, 20));
    bench(criterion, "count_neighbors", |rope| count_neighbors(&rope.points, RADIUS));
}

fn normals(criterion: &mut Criterion) {
    let camera = Viewpoints::One([0.0, 0.0, 1.0]);
    bench(criterion, "normals/k=30", |rope| estimate_normals(&rope.points, Neighbors::Nearest(30), camera));
    let radius = Neighbors::Within(0.5 * RADIUS);
    bench(criterion, "normals/radius", |rope| estimate_normals(&rope.points, radius, camera));
}

/// Times three updates of the pose from a start that is 0.4 mm off.
fn registration(criterion: &mut Criterion) {
    let options = IcpOptions {
        start: RigidMotion { translation: Vector3::new(2e-4, -2e-4, 3e-4), ..RigidMotion::identity() },
        max_correspondence_distance: 0.5 * RADIUS,
        max_iterations: 3,
        tolerance: 0.0,
    };
    bench(criterion, "icp/point to point", |rope| {
        icp(&rope.points, &rope.points, Objective::PointToPoint, &options)
    });
    bench(criterion, "icp/point to plane", |rope| {
        icp(&rope.points, &rope.points, Objective::PointToPlane(&rope.normals), &options)
    });
}

fn axis_points(criterion: &mut Criterion) {
    bench(criterion, "centerline", |rope| centerline(&rope.points, &rope.normals, RADIUS, 20));
}

fn tracing(criterion: &mut Criterion) {
    bench(criterion, "trace_chains", |rope| trace_chains(&rope.axis, RADIUS, 2.5 * RADIUS, None));
}

criterion_group!(kernels, filter, normals, registration, axis_points, tracing);
criterion_main!(kernels);
