//! The crate's k-d tree against kiddo's, on a rope's surface: what decided that it has one of its own.
//!
//! `cargo bench --bench trees`. One thread; a coiled tube of radius 4.2 mm, one point per 0.4 x 0.4 mm of it, in no order;
//! places asked for are points moved by up to a millimetre, as those of a view that is not yet registered.

mod random;
mod rope;

use std::hint::black_box;
use std::num::NonZeroUsize;
use std::time::Duration;

use criterion::{BatchSize, BenchmarkId, Criterion, SamplingMode, criterion_group, criterion_main};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use strand::{Point, Tree, set_num_threads};

use random::generator;
use rope::Rope;

/// Places asked for.
const ASKED: usize = 10_000;
/// Neighbours of each, where several are asked for.
const SEVERAL: NonZeroUsize = NonZeroUsize::new(16).unwrap();
/// How far places are from points, metres.
const MOVED: f64 = 1e-3;

fn trees(criterion: &mut Criterion) {
    set_num_threads(1);
    let mut group = criterion.benchmark_group("trees");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    group.sampling_mode(SamplingMode::Flat);
    for count in [10_000, 100_000, 1_000_000] {
        let points = Rope::new(count, generator(1)).points;
        let mut random = generator(2);
        let asked: Vec<Point> =
            (0..ASKED).map(|i| points[i * count / ASKED].map(|x| x + MOVED * (random() - 0.5))).collect();
        let ours = || Tree::new(&points).unwrap();
        let theirs = || ImmutableKdTree::<f64, 3>::new_from_slice(&points).unwrap();
        let mut time = |name: &str, work: &dyn Fn() -> usize| {
            group.bench_function(BenchmarkId::new(name, count), |bencher| bencher.iter(|| black_box(work())));
        };
        let (tree, other) = (ours(), theirs());
        time("nearest/strand", &|| {
            asked.iter().filter_map(|&p| tree.nearest_within(p, f64::MAX)).map(|(i, _)| i).sum()
        });
        time("nearest/kiddo", &|| {
            let nearest = |p| other.query(p).nearest_one::<SquaredEuclidean<f64>>().execute();
            asked.iter().map(|p| nearest(p).item as usize).sum()
        });
        time("16 nearest/strand", &|| asked.iter().flat_map(|&p| tree.nearest(p, SEVERAL)).sum());
        time("16 nearest/kiddo", &|| {
            let nearest = |p| other.query(p).nearest_n::<SquaredEuclidean<f64>>(SEVERAL).execute();
            asked.iter().flat_map(nearest).map(|found| found.item as usize).sum()
        });
        group.bench_function(BenchmarkId::new("built/strand", count), |bencher| {
            bencher.iter_batched(|| (), |()| ours(), BatchSize::PerIteration);
        });
        group.bench_function(BenchmarkId::new("built/kiddo", count), |bencher| {
            bencher.iter_batched(|| (), |()| theirs(), BatchSize::PerIteration);
        });
    }
    group.finish();
    set_num_threads(0);
}

criterion_group!(all, trees);
criterion_main!(all);
