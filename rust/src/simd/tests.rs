//! Answers are equal bit for bit for every instruction set. `./run check` also runs these tests under valgrind.

use std::f64::consts::{PI, TAU};
use std::fmt::Debug;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

use super::{BATCH, Eight, LANES, Lanes, PORTABLE, Singles, Three, WIDEST, detected, kernel};
use crate::images::readings::find_readings;
use crate::images::silhouette::Silhouette;
use crate::{
    DepthView, IcpOptions, Neighbors, Objective, Pinhole, Point, Residual, RigidMotion, Spline, Tube,
    TubeFitOptions, TubeView, Viewpoints, centerline, count_neighbors, crop_images, estimate_normals,
    fit_tubes, icp, trace_tubes,
};

/// Locked by the test that selects the instruction set; it does not matter to other tests.
static CHOOSING: Mutex<()> = Mutex::new(());

/// Asserts that some work gives equal results with every instruction set of the processor, portable code included.
fn assert_same_with_each<T: PartialEq>(work: impl Fn() -> T) {
    let _alone = CHOOSING.lock();
    let widest = detected();
    WIDEST.store(PORTABLE, Ordering::Relaxed);
    let expected = work();
    for number in PORTABLE + 1..=widest {
        WIDEST.store(number, Ordering::Relaxed);
        assert!(work() == expected, "set {number}");
    }
}

/// Returns the bits of some numbers.
fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

kernel! {
    /// Applies all operations on eight numbers.
    fn operations_on_eight<S>(simd, a: &Lanes, b: &Lanes) -> Vec<Vec<u32>> {
        let (a, b, two) = (simd.load8(a), simd.load8(b), simd.splat8(2.0));
        let (x, y) = (Three([a, b, a]), Three([b, a, two]));
        let three = (x.cross(y) + x - y).unit(simd).0;
        let columns = simd.transpose8([a, b, two, a * b, a - b, a + b, two * b, three[0]]);
        let mut results: Vec<Vec<u32>> = columns.iter().map(|x| bits(&x.0)).collect();
        results.extend([
            a + b,
            a - b,
            a * b,
            a / b,
            a.abs().sqrt(),
            a.floor(),
            a.max(b),
            a.min(b),
            a.below(b),
            a.not_above(b),
            a.below(b).choose(a, b),
            x.dot(y),
            (Three::all(simd, [0.1, 0.2, 0.3]) * a).0[1],
            three[0],
            three[2],
            simd.splat8(a.sum() as f32),
        ]
        .map(|x| bits(&x.store().0)));
        results
    }
}

kernel! {
    /// Applies all operations on a batch.
    fn operations_on_a_batch<S>(simd, a: &Singles, b: &Singles) -> Vec<Vec<u32>> {
        let (x, y) = (simd.load(a), simd.load(b));
        let less = simd.le(x, y);
        let chosen = simd.mask(0b0110_1001_1100_0101);
        let mut packed = [0.0; BATCH];
        simd.compress(0b0110_1001_1100_0101, x, &mut packed);
        let wide = a.map(f64::from);
        let count = simd.add_whole_if(less, simd.splat_whole(i32::MAX), simd.splat_whole(3));
        let mut results: Vec<Vec<u32>> = [
            simd.add(x, y),
            simd.sub(x, y),
            simd.div(x, y),
            simd.mul(x, y),
            simd.min(x, y),
            simd.max(x, y),
            simd.select(less, x, simd.splat(0.5)),
            simd.sqrt(simd.mul(x, x)),
            simd.narrow(&wide, 0.1, 7.0),
            simd.narrow_each(&wide, &b.map(f64::from), 7.0),
        ]
        .map(|x| bits(&simd.store(x)))
        .to_vec();
        results.push(bits(&packed[..8]));
        results.push([less, chosen, simd.or(less, chosen), simd.xor(less, chosen)].map(|m| simd.bits(m)).to_vec());
        results.push(simd.store_whole(count).map(|x| x as u32).to_vec());
        for half in [simd.half::<false>(chosen), simd.half::<true>(chosen)] {
            let tenth = simd.load_half(&[0.1; LANES]);
            let sums = simd.sub_half(simd.mul_half(tenth, tenth), simd.splat_half(0.3));
            let sums = simd.add_half_if(half, sums, simd.splat_half(1e-9));
            // one of the numbers equals its sum
            let own = simd.store_half(sums);
            let other = |l: usize| if l == 3 { own[l] } else { f64::from(a[l]) - 0.5 };
            let eight = simd.load_half(&std::array::from_fn(other));
            let chosen = simd.choose_half(eight, sums, simd.add_half(eight, sums), sums);
            let none = simd.splat_half(f64::NAN);
            results.push(vec![simd.lt_half(eight, sums), simd.lt_half(eight, none), simd.lt_half(none, eight)]);
            results.push(bits(&simd.narrow_half(chosen).store().0));
            let sums = simd.store_half(chosen);
            results.push(sums.iter().flat_map(|x| [x.to_bits() as u32, (x.to_bits() >> 32) as u32]).collect());
        }
        results
    }
}

#[test]
fn operations_round_alike() {
    let a = [0.1, -2.7, 3e8, -0.0, 5.5, 1e-20, 7.7, 8.0];
    let b = [0.3, 2.7, -3e8, 1.0, 5.5, 1e-10, -7.1, 0.9];
    assert_same_with_each(|| operations_on_eight(&Lanes(a), &Lanes(b)));
    let batch = |x: [f32; LANES], y: [f32; LANES]| -> Singles {
        std::array::from_fn(|l| [x, y][l / LANES][l % LANES])
    };
    assert_same_with_each(|| operations_on_a_batch(&batch(a, b), &batch(b, b)));
}

/// Returns the upper side of a tube of radius 1 in a wave, with some points twice.
fn tube(count: u32) -> Vec<Point> {
    (0..count)
        .map(|i| {
            // low-discrepancy numbers
            let at = |step: f64| (f64::from(i % (count - count / 20)) * step).fract();
            let (x, angle) = (0.012 * f64::from(count) * at(0.754_877_666), PI * at(0.569_840_291));
            let radius = 1.0 + 0.05 * at(0.438_579_021);
            [x, (TAU * x / 40.0).sin() + radius * angle.cos(), radius * angle.sin()]
        })
        .collect()
}

/// Returns the results of all kernels for a cloud as text that shows every bit.
fn answers(points: &[Point]) -> Vec<String> {
    let mut answers = Vec::new();
    let mut note = |answer: &dyn Debug| answers.push(format!("{answer:?}"));
    let above = Viewpoints::One([0.0, 0.0, 100.0]);
    note(&count_neighbors(points, 0.6).unwrap());
    note(&estimate_normals(points, Neighbors::Nearest(12), above).unwrap());
    let surface = estimate_normals(points, Neighbors::Within(0.6), above).unwrap();
    note(&surface);
    note(&centerline(points, &surface.normals, 1.0, 5).unwrap());

    let source: Vec<Point> = points.iter().map(|p| [p[0] + 0.06, p[1] - 0.03, p[2] + 0.09]).collect();
    let options = IcpOptions {
        start: RigidMotion::identity(),
        max_correspondence_distance: 0.3,
        max_iterations: 4,
        tolerance: 0.0,
    };
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&surface.normals)] {
        note(&icp(&source, points, objective, &options).unwrap());
    }

    let depth: Vec<f64> = points.iter().map(|p| 10.0 - p[2]).collect();
    let camera = Pinhole { focal: [30.0; 2], center: [18.0, 9.0] };
    let view = DepthView { depth: &depth, width: 37, camera, pose: RigidMotion::identity() };
    note(&crop_images(&[view], [[-3.0, -4.0, 8.5], [3.0, 4.0, 9.9]]));

    note(&trace_tubes(points, above, 1.0, 4).unwrap());
    let length = points.iter().fold(0.0, |most: f64, p| most.max(p[0]));
    let axis: Vec<Point> =
        (0..=20).map(|i| f64::from(i) / 20.0 * length).map(|x| [x, (TAU * x / 40.0).sin(), 0.1]).collect();
    let views = [TubeView { points, viewpoint: [0.0, 0.0, 100.0], end_observations: &[], foot_points: &[] }];
    let tubes = [Tube { curve: Spline::through(&axis, 2.5, 0.0).unwrap(), radius_class: 0 }];
    for residual in [Residual::Ray, Residual::Distance] {
        let options =
            TubeFitOptions { residual, iterations: 3, tolerance: 1e-9, ..TubeFitOptions::default() };
        let fit = fit_tubes(&views, &tubes, &[RigidMotion::identity()], &[1.0], &options).unwrap();
        assert!(fit.foot_points[0].iter().any(|foot| foot.inlier));
        note(&fit);
    }
    answers
}

#[test]
fn kernels_answer_alike() {
    // more words than are sorted in one go
    let points = tube(3000);
    assert!(!trace_tubes(&points, Viewpoints::One([0.0, 0.0, 100.0]), 1.0, 4).unwrap().is_empty());
    assert_same_with_each(|| answers(&points));
}

#[test]
fn masks_are_read_alike() {
    // a bent strip that crosses itself, magnified
    let (width, height) = (160, 110);
    let axis: Vec<[f64; 2]> = (0..400)
        .map(|i| TAU * f64::from(i) / 400.0)
        .map(|t| [80.0 + 55.0 * t.sin(), 55.0 + 38.0 * (1.6 * t + 0.3).sin()])
        .collect();
    let inside = |k: usize| {
        let (u, v) = ((k % width) as f64, (k / width) as f64);
        axis.iter().any(|x| (x[0] - u).powi(2) + (x[1] - v).powi(2) < 25.0)
    };
    let mask: Vec<bool> = (0..width * height).map(inside).collect();
    let read = || {
        let silhouette = Silhouette::of_rope(&mask, width, 5.0).unwrap();
        let found = find_readings(&silhouette, Some(1), 2);
        assert!(!found.is_empty());
        format!("{silhouette:?} {found:?}")
    };
    assert_same_with_each(read);
}
