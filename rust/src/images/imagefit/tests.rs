//! Fits to images of known ropes, without noise.

use nalgebra::{Rotation3, Vector3};

use super::lift::Lifted;
use super::medians::Medians;
use super::places::Place2;
use super::*;
use crate::clouds::depth::Pinhole;
use crate::geometry::{Point, RigidMotion, advance, squared_distance};
use crate::images::silhouette::Silhouette;

/// A rope and the nodes of its axis.
#[derive(Clone)]
pub struct Rope {
    pub nodes: Vec<Point>,
    pub radius: f64,
}

impl Rope {
    fn along(radius: f64, place: impl Fn(f64) -> Point) -> Self {
        Self { nodes: (0..=400).map(|i| place(f64::from(i) / 200.0 - 1.0)).collect(), radius }
    }

    pub fn straight(radius: f64) -> Self {
        Self::along(radius, |s| [0.09 * s, 0.01 * s, radius])
    }

    pub fn bent(radius: f64) -> Self {
        Self::along(radius, |s| [0.09 * s, 0.02 * (3.0 * s).cos(), radius])
    }

    /// A rope across the middle of the straight one, on top of it.
    fn over(radius: f64) -> Self {
        Self::along(radius, |s| [0.02 * s, 0.08 * s, radius * (1.0 + 2.0 * (-(s / 0.25).powi(2)).exp())])
    }
}

/// A camera's image of ropes on the table z = 0.
pub struct Image {
    silhouette: Silhouette,
    medians: Medians,
    pinhole: Pinhole,
    pose: RigidMotion,
}

const SIZE: [usize; 2] = [360, 300];

impl Image {
    pub fn rope_view(&self) -> RopeView<'_> {
        RopeView {
            silhouette: &self.silhouette,
            medians: &self.medians,
            pinhole: self.pinhole,
            pose: self.pose,
            size: SIZE,
        }
    }
}

/// Returns the image of a camera that looks down, tilted about x.
pub fn view(ropes: &[Rope], camera: Point, tilt: f64) -> Image {
    let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI + tilt).into_inner();
    let pose = RigidMotion { rotation, translation: Vector3::from(camera) };
    let pinhole = Pinhole { focal: [700.0, 700.0], center: [180.0, 150.0] };
    let mut depth = vec![0.0f64; SIZE[0] * SIZE[1]];
    let turn = rotation.transpose();
    for rope in ropes {
        for node in &rope.nodes {
            let y: Point = (turn * (Vector3::from(*node) - pose.translation)).into();
            let radius_px = pinhole.focal[0] * rope.radius / y[2];
            let at = [0, 1].map(|k| pinhole.focal[k] * y[k] / y[2] + pinhole.center[k]);
            for v in (at[1] - radius_px).ceil() as usize..=(at[1] + radius_px) as usize {
                for u in (at[0] - radius_px).ceil() as usize..=(at[0] + radius_px) as usize {
                    let off =
                        ((u as f64 - at[0]).powi(2) + (v as f64 - at[1]).powi(2)) / (radius_px * radius_px);
                    if off < 1.0 {
                        let z = y[2] - rope.radius * (1.0 - off).sqrt();
                        let pixel = &mut depth[v * SIZE[0] + u];
                        *pixel = if *pixel > 0.0 { pixel.min(z) } else { z };
                    }
                }
            }
        }
    }
    let mask: Vec<bool> = depth.iter().map(|&z| z > 0.0).collect();
    let distance = camera[2] / tilt.cos();
    let silhouette =
        Silhouette::new(&mask, SIZE[0], pinhole.focal[0] * ropes[0].radius / distance, 3).unwrap();
    let medians = Medians::new(&depth, &mask, SIZE[0], &silhouette, silhouette.radius_px);
    Image { silhouette, medians, pinhole, pose }
}

/// Returns the ropes' axes in an image, pixels.
fn drawn(view: &RopeView, ropes: &[Rope]) -> Vec<Vec<Place2>> {
    ropes.iter().map(|rope| rope.nodes.iter().map(|&x| view.projected(view.seen(x))).collect()).collect()
}

/// Returns the largest distance of inner nodes from a rope's axis, radii.
fn farthest(nodes: &[Point], rope: &Rope) -> f64 {
    let squares = nodes[3..nodes.len() - 3]
        .iter()
        .map(|&p| rope.nodes.iter().map(|&q| squared_distance(p, q)).fold(f64::INFINITY, f64::min));
    squares.fold(0.0, f64::max).sqrt() / rope.radius
}

const TABLE: Plane = Plane { normal: [0.0, 0.0, 1.0], offset: 0.0 };

fn options(noise: f64) -> ImageFitOptions {
    ImageFitOptions {
        iterations: 10,
        far: count_far(10),
        reference: 0,
        held: Some(0),
        pose_sd: [0.01, 2e-3],
        noise,
        uncertainty: true,
    }
}

fn pairs(lifted: &Lifted) -> Vec<Vec<[OnChain; 2]>> {
    lifted.crossings.iter().map(|c| c.ordered().collect()).collect()
}

#[test]
fn ropes_of_one_view_are_where_they_are() {
    for rope in [Rope::straight(0.004), Rope::bent(0.004)] {
        let image = view(std::slice::from_ref(&rope), [0.0, -0.1, 0.5], 0.2);
        let view = image.rope_view();
        let chains = drawn(&view, std::slice::from_ref(&rope));
        let lifted = lift(&view, &chains, 0.004, Some(TABLE), &Sensor::DEFAULT).unwrap();
        assert!(lifted.crossings.is_empty());
        let views = [view];
        let fitted =
            fit(&views, &lifted.nodes, 0.004, Some(TABLE), &[], &Sensor::DEFAULT, &options(lifted.sigma))
                .unwrap();
        let far = farthest(&fitted.nodes[0], &rope);
        assert!(far < 0.2, "{far}");
        assert!(fitted.misfit.uncovered < 0.1 && fitted.misfit.outside < 0.5, "{:?}", fitted.misfit);
        // depth is less certain than the place across the rays
        let middle = fitted.covariances[0].len() / 2;
        let covariance = fitted.covariances[0][middle];
        assert!(covariance[2][2] > 2.0 * covariance[1][1] && covariance[1][1] > 0.0, "{covariance:?}");
        let again =
            fit(&views, &lifted.nodes, 0.004, Some(TABLE), &[], &Sensor::DEFAULT, &options(lifted.sigma));
        assert_eq!(again.unwrap(), fitted);
    }
}

#[test]
fn the_upper_strand_is_on_top_and_both_keep_apart() {
    let ropes = [Rope::straight(0.004), Rope::over(0.004)];
    for swapped in [false, true] {
        let mut ropes = ropes.to_vec();
        if swapped {
            ropes.reverse();
        }
        let image = view(&ropes, [0.0, -0.05, 0.5], 0.1);
        let view = image.rope_view();
        let lifted = lift(&view, &drawn(&view, &ropes), 0.004, Some(TABLE), &Sensor::DEFAULT).unwrap();
        let [crossing] = &lifted.crossings[..] else { panic!("{} crossings", lifted.crossings.len()) };
        assert_eq!(crossing.first_on_top, swapped);
        assert!(crossing.margin > 1.0, "{}", crossing.margin);
        let pairs = pairs(&lifted);
        let fitted =
            fit(&[view], &lifted.nodes, 0.004, Some(TABLE), &pairs, &Sensor::DEFAULT, &options(lifted.sigma))
                .unwrap();
        for (nodes, rope) in fitted.nodes.iter().zip(&ropes) {
            let far = farthest(nodes, rope);
            assert!(far < 0.6, "{far}");
        }
        let upper = fitted.nodes[usize::from(!swapped)].iter().map(|p| p[2]).fold(0.0, f64::max);
        assert!(upper > 0.004 * 2.4, "{upper}");
    }
}

#[test]
fn a_fit_through_other_nodes_keeps_what_it_knows() {
    let ropes = [Rope::straight(0.004), Rope::over(0.004)];
    let image = view(&ropes, [0.0, -0.05, 0.5], 0.1);
    let view = image.rope_view();
    let lifted = lift(&view, &drawn(&view, &ropes), 0.004, Some(TABLE), &Sensor::DEFAULT).unwrap();
    let pairs = pairs(&lifted);
    let before =
        fit(&[view], &lifted.nodes, 0.004, Some(TABLE), &pairs, &Sensor::DEFAULT, &options(lifted.sigma))
            .unwrap();
    let mut nodes = before.nodes.clone();
    nodes[1].drain(..10);
    let (now, moved) = before.through(&nodes, &pairs, 0.004);
    for (nodes, wanted) in now.nodes.iter().zip(&nodes) {
        for (end, wanted) in [(nodes.first(), wanted.first()), (nodes.last(), wanted.last())] {
            assert!(squared_distance(*end.unwrap(), *wanted.unwrap()).sqrt() < 0.1 * 0.004);
        }
    }
    let place = |fit: &ImageFit, on: OnChain| {
        let nodes = &fit.nodes[on.chain];
        nodes[(on.share * (nodes.len() - 1) as f64).round() as usize]
    };
    let both = pairs.iter().flatten().flatten().zip(moved.iter().flatten().flatten());
    assert!(both.clone().count() > 4);
    for (was, is) in both {
        assert!(squared_distance(place(&before, *was), place(&now, *is)).sqrt() < 0.3 * 0.004);
    }
    // each node of the shorter rope has the covariance of the old node there
    assert_eq!(now.covariances[1].len(), now.nodes[1].len());
    assert_eq!(now.covariances[1].last(), before.covariances[1].last());
    assert_eq!(now.covariances[1][0], before.covariances[1][10]);
    assert_eq!(now.misfit, before.misfit);
    assert_eq!(now.corrections, before.corrections);
    // a crossing that is cut off is dropped
    let beyond = nodes[1].len() / 2 + 8;
    nodes[1].drain(..beyond);
    let (_, left) = before.through(&nodes, &pairs, 0.004);
    assert_eq!(left.len(), pairs.len());
    assert!(left.iter().all(Vec::is_empty), "{left:?}");
}

#[test]
fn a_wrong_pose_is_put_right() {
    let rope = Rope::bent(0.004);
    let truth = view(std::slice::from_ref(&rope), [0.0, 0.0, 0.5], 0.0);
    let other = view(std::slice::from_ref(&rope), [0.0, -0.25, 0.45], 0.5);
    let mut wrong = other.rope_view();
    wrong.pose.translation = advance(wrong.pose.translation.into(), 1.5e-3, [0.0, 1.0, 0.0]).into();
    let first = truth.rope_view();
    let chains = drawn(&first, std::slice::from_ref(&rope));
    let lifted = lift(&first, &chains, 0.004, None, &Sensor::DEFAULT).unwrap();
    let views = [first, wrong];
    let fitted =
        fit(&views, &lifted.nodes, 0.004, None, &[], &Sensor::DEFAULT, &options(lifted.sigma)).unwrap();
    assert!(farthest(&fitted.nodes[0], &rope) < 0.3);
    assert_eq!(fitted.corrections[0], [0.0; 6]);
    // the second view sees the rope where it is
    let seen = views[1].seen(rope.nodes[200]);
    let [a, b, c, d, e, f] = fitted.corrections[1];
    let turned = crate::geometry::cross([a, b, c], seen);
    let moved: Point = std::array::from_fn(|k| seen[k] + turned[k] + [d, e, f][k]);
    let [before, after] = [seen, moved].map(|y| {
        let right = other.rope_view().projected(other.rope_view().seen(rope.nodes[200]));
        (views[1].projected(y)[1] - right[1]).abs()
    });
    assert!(before > 1.5 && after < 0.7, "{before} {after}");
}
