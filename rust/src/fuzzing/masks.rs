//! Ropes in masks: silhouettes, readings, and the fit to images.

use super::bytes::{Bytes, require_finite};
use super::drawing::Scene;
use crate::checks::check_positive;
use crate::geometry::dot;
use crate::images::imagefit::{self, ImageFitOptions, OnChain, Plane, Prepared, Sensor};
use crate::images::readings::{self, find_readings};
use crate::images::rope_mask::RopeMask;

const MAX_LENGTH: f64 = 1e5; // length of a polyline that the bindings accept, pixels

pub fn read_masks(mut bytes: Bytes<'_>) {
    let scene = Scene::new(&mut bytes);
    let (ropes, most, odd) = (bytes.below(4), 1 + bytes.below(3), bytes.below(8) == 0);
    let [width, _] = scene.size;
    if let Some(shown) = RopeMask::new(&scene.mask, width).estimate_radius() {
        assert!(shown > 0.0 && shown.is_finite());
    }
    let radius = if odd { bytes.length() } else { scene.radius() };
    let mask_px = (bytes.below(4) == 0).then(|| 0.5 + bytes.ordinary().abs());
    if check_positive("radius", radius).is_err() {
        return;
    }
    let (pose, camera) = (bytes.ordinary_motion(), scene.camera);
    let prepared = Prepared::new(&scene.depth, &scene.mask, scene.size, camera, pose, radius, mask_px);
    let Some(view) = prepared else { return };
    let radius_px = view.silhouette.radius_px;
    assert!(radius_px > 0.0 && radius_px.is_finite());
    let plane = bytes.flag().then(|| {
        let normal = (-pose.rotation.column(2)).into_owned().into();
        Plane { normal, offset: dot(normal, pose.apply([0.0, 0.0, scene.axis + radius])) }
    });
    let views = [view.rope_view()];
    for reading in find_readings(&view.silhouette, (ropes > 0).then_some(ropes), most) {
        assert!(reading.cost.is_finite(), "{}", reading.cost);
        let chains = readings::extend(&view.silhouette, &reading.chains);
        chains.iter().for_each(|chain| require_finite(chain));
        assert!(!readings::price(&view.silhouette, &chains).is_nan());
        let length = |chain: &Vec<[f64; 2]>| -> f64 {
            chain.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
        };
        assert!(chains.iter().all(|chain| length(chain) < MAX_LENGTH));
        let lifted = imagefit::lift(&views[0], &chains, radius, plane, &Sensor::DEFAULT);
        let Some(lifted) = lifted else { continue };
        lifted.nodes.iter().for_each(|nodes| require_finite(nodes));
        assert!(lifted.sigma > 0.0 && lifted.sigma.is_finite());
        let options = ImageFitOptions {
            iterations: 3,
            far: imagefit::count_far(3),
            reference: 0,
            held: Some(0),
            pose_sd: [0.01, 0.001],
            noise: lifted.sigma,
            uncertainty: true,
        };
        let pairs: Vec<Vec<[OnChain; 2]>> = lifted.crossings.iter().map(|c| c.ordered().collect()).collect();
        let fit = imagefit::fit(&views, &lifted.nodes, radius, plane, &pairs, &Sensor::DEFAULT, &options);
        if let Some(fit) = fit {
            fit.curves.iter().for_each(|curve| require_finite(&curve.control));
            fit.nodes.iter().for_each(|nodes| require_finite(nodes));
            fit.covariances.iter().flatten().for_each(|covariance| require_finite(covariance));
        }
    }
}
