//! Ropes in space: tracking, tracing, and the joint fit of tubes and poses.

use super::bytes::{Bytes, require_finite};
use super::drawing::Scene;
use crate::geometry::{Point, RigidMotion, advance, cross, dot, normalized, sub};
use crate::track::camera::Camera;
use crate::track::openings::Table;
use crate::track::rope::{Hold, MIN_TRACKED, Rope};
use crate::track::update::{Options, update};
use crate::tubes::ends::{OnTubes, rope_extents};
use crate::tubes::tubefit::placed;
use crate::{
    EndObservation, Residual, Spline, Tube, TubeFitOptions, TubeView, Viewpoints, fit_tubes, trace_tubes,
};

pub fn track(mut bytes: Bytes<'_>) {
    let scene = Scene::new(&mut bytes);
    let (steps, frames, elapsed) = (1 + bytes.below(4), 1 + bytes.below(3), bytes.below(8) as f64 / 30.0);
    let options = Options {
        steps,
        elapsed: elapsed.max(0.01),
        bias_gain: bytes.below(3) as f64 * 0.5,
        free: bytes.flag(),
    };
    let pose = bytes.ordinary_motion();
    let (shift, tilt) = (bytes.ordinary_point(), 0.01 * bytes.ordinary());
    let mut ropes: Vec<Rope> =
        (0..scene.strokes.len()).map(|k| make_rope(&mut bytes, &scene, &pose, k, shift)).collect();
    let table = bytes.flag().then(|| {
        let normal = normalized((-pose.rotation.column(2)).into_owned().into());
        let at = pose.apply([0.0, tilt, scene.axis + scene.radius()]);
        Table { normal, offset: dot(normal, at) }
    });
    let occluders: Vec<bool> = (0..scene.mask.len()).map(|k| k % scene.size[0] < 4).collect();
    let hides = bytes.flag();
    for _ in 0..frames {
        let camera = Camera {
            depth: &scene.depth,
            mask: &scene.mask,
            occluders: hides.then_some(&occluders),
            width: scene.size[0],
            pinhole: scene.camera,
            pose,
            delay: 0.0,
            bias: 0.0,
        };
        let mut cameras = [camera];
        let outcome = update(&mut cameras, &mut ropes, table, options);
        assert!(cameras[0].bias.is_finite() && outcome.noise.iter().all(|x| x.is_finite()));
        assert!((0.0..=1.0 + 1e-9).contains(&outcome.unexplained), "{}", outcome.unexplained);
        for (rope, found) in ropes.iter().zip(&outcome.ropes) {
            require_finite(&rope.nodes);
            require_finite(&rope.velocities);
            assert!(rope.variance.iter().chain(&rope.noise).all(|&x| x >= 0.0 && x.is_finite()));
            found.covariances.iter().for_each(|covariance| require_finite(covariance));
            assert!(found.seen.iter().all(|share| (0.0..=1.0 + 1e-9).contains(share)));
            assert!((0.0..=1.0).contains(&found.through));
        }
    }
}

/// Makes a rope near one of the scene's.
fn make_rope(bytes: &mut Bytes<'_>, scene: &Scene, pose: &RigidMotion, number: usize, shift: Point) -> Rope {
    let count = MIN_TRACKED + bytes.below(8);
    let radius = scene.radius();
    let mut nodes = scene.nodes(number, count);
    if bytes.flag() {
        nodes.iter_mut().for_each(|node| *node = advance(*node, radius, bytes.ordinary_point()));
    }
    let nodes: Vec<Point> = nodes.iter().map(|&p| advance(pose.apply(p), radius, shift)).collect();
    let length: f64 = nodes.windows(2).map(|pair| crate::track::rope::length(sub(pair[1], pair[0]))).sum();
    let speed = 0.1 * bytes.ordinary();
    let holds = (0..bytes.below(3))
        .map(|_| Hold { at: bytes.below(count) as f64, point: nodes[bytes.below(count)], sd: 1e-3 })
        .collect();
    Rope {
        velocities: vec![[speed, 0.0, -speed]; count],
        variance: vec![radius * radius; count],
        noise: vec![0.1 * radius * radius; count],
        last: nodes.clone(),
        age: (0..count).map(|_| bytes.below(3) as f64 / 30.0).collect(),
        radius,
        spacing: (length / (count - 1) as f64).max(0.1 * radius),
        slid: bytes.flag().then_some(0.1 * radius),
        covers: [None, bytes.flag().then_some(radius)],
        holds,
        nodes,
    }
}

pub fn fit(mut bytes: Bytes<'_>) {
    let radius = if bytes.below(8) == 0 { bytes.length() } else { 0.25 };
    let (spacing, around) = (0.3 + 0.2 * bytes.ordinary().abs(), 1 + bytes.below(16));
    let views = 1 + bytes.below(2);
    let axes: Vec<Vec<Point>> = (0..1 + bytes.below(2)).map(|_| bytes.points(10)).collect();
    let viewpoint = bytes.point();
    let mut points = bytes.points(16);
    for pair in axes.iter().flat_map(|axis| axis.windows(2)) {
        points.extend(cover(&mut bytes, pair, radius, around));
    }
    let min_nodes = bytes.below(6);
    if let Ok(arcs) = trace_tubes(&points, Viewpoints::One(viewpoint), radius, min_nodes) {
        for arc in arcs {
            require_finite(&arc.nodes);
            assert!(arc.nodes.len() == arc.support.len() && arc.support.iter().all(|x| x.is_finite()));
        }
    }
    let curves = axes.iter().filter_map(|axis| Spline::through(axis, spacing, 0.0).ok());
    let tubes: Vec<Tube> = curves.map(|curve| Tube { curve, radius_class: 0 }).collect();
    let options = TubeFitOptions {
        fit_curves: bytes.below(4) > 0,
        radius_prior: bytes.flag().then(|| vec![[radius, 0.1 * radius]]),
        reference: bytes.flag().then_some(0),
        residual: if bytes.flag() { Residual::Ray } else { Residual::Distance },
        iterations: bytes.below(4),
        min_bend: 0.1 + bytes.ordinary().abs(),
        noise: bytes.flag().then(|| bytes.length()),
        shared: [1.0 + bytes.ordinary().abs(), 1.0],
        bounds: bytes.flag().then(|| [bytes.point(), bytes.point()]),
        uncertainty: bytes.flag(),
        ..TubeFitOptions::DEFAULT
    };
    let seen = EndObservation { end: 0, place: bytes.ordinary_point(), outward: bytes.unit(), sd: 0.1 };
    let ends = if bytes.flag() { vec![seen] } else { vec![] };
    let parts = points.chunks(points.len().div_ceil(views).max(1));
    let views: Vec<TubeView> = parts
        .map(|points| TubeView { points, viewpoint, end_observations: &ends, foot_points: &[] })
        .collect();
    let motions = vec![RigidMotion::identity(); views.len()];
    let Ok(found) = fit_tubes(&views, &tubes, &motions, &[radius], &options) else { return };
    found.curves.iter().for_each(|curve| require_finite(&curve.control));
    found.motions.iter().for_each(|motion| require_finite(&motion.to_rows()));
    let widths = [&found.radii[..], &found.bands].concat();
    assert!(widths.iter().all(|x| x.is_finite() && *x > 0.0), "{widths:?} {radius:e}");
    assert!(found.sigma.is_finite() && found.sigma >= 0.0);
    if let Some(uncertainty) = &found.uncertainty {
        assert!(uncertainty.radii.iter().all(|sd| sd.is_finite() && *sd >= 0.0));
        uncertainty.poses.iter().for_each(|pose| require_finite(pose));
        uncertainty.curves.iter().flatten().flatten().for_each(|part| require_finite(part));
    }
    let tubes: Vec<Tube> =
        found.curves.iter().map(|curve| Tube { curve: curve.clone(), radius_class: 0 }).collect();
    let (position, to_camera) = placed(&views, &found.motions);
    let feet = found.foot_points.concat();
    let on_tubes = OnTubes {
        inlier: &feet.iter().map(|foot| foot.inlier).collect::<Vec<bool>>(),
        curve: &feet.iter().map(|foot| foot.curve as i64).collect::<Vec<i64>>(),
        parameter: &feet.iter().map(|foot| foot.parameter).collect::<Vec<f64>>(),
        position: &position,
        to_camera: &to_camera,
    };
    if let Ok(extents) = rope_extents(&tubes, &found.radii, &on_tubes, None) {
        for (tube, [first, last]) in tubes.iter().zip(extents).filter_map(|(tube, ends)| Some((tube, ends?)))
        {
            assert!(0.0 <= first && first <= last && last <= tube.curve.end(), "{first} {last}");
        }
    }
}

/// Returns points of the surface around a straight piece of rope.
fn cover(bytes: &mut Bytes<'_>, pair: &[Point], radius: f64, around: usize) -> Vec<Point> {
    let step = sub(pair[1], pair[0]);
    let across = normalized(cross(step, [0.3, -0.5, 0.8]));
    let up = normalized(cross(across, step));
    (0..around)
        .map(|i| {
            let (along, angle) = (f64::from(bytes.byte()) / 255.0, i as f64 * 2.4);
            let (sin, cos) = angle.sin_cos();
            advance(advance(advance(pair[0], along, step), radius * cos, across), radius * sin, up)
        })
        .collect()
}
