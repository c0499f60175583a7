//! How much better depth agrees with ropes on a plane than with the bare plane.

use super::{Plane, RopeView};
use crate::Point;
use crate::geometry::{cross, dot, normalized, squared_distance, sub};
use crate::image::Image;

/// Squares of residuals over the noise count up to this.
const LIMIT: f64 = 9.0;
/// Balls that stand for a tube are so far apart, radii.
const APART: f64 = 0.25;
/// A camera sees nothing nearer than this, metres.
const NEAREST: f64 = 1e-3;

/// The sum over a view's pixels of how much smaller the squared residual over the noise is with the ropes, each square
/// limited: twice the log of how much likelier the depths are, for errors that are independent from pixel to pixel.
///
/// `correction` turns and moves the camera frame, `noise` is in metres.
pub fn depth_gain(
    view: &RopeView,
    depth: &Image<f32>,
    correction: &[f64; 6],
    chains: &[Vec<Point>],
    radius: f64,
    plane: Plane,
    noise: f64,
) -> f64 {
    let shown = rendered(view, correction, chains, radius);
    let (normal, height) = (view.untwisted(correction, plane.normal), view.height(correction, plane));
    let mut gain = 0.0;
    for (k, (&rope, &seen)) in shown.values.iter().zip(&depth.values).enumerate() {
        if rope == f32::INFINITY || seen.is_nan() || seen <= 0.0 {
            continue;
        }
        let ray = view.ray([(k % depth.width) as f64, (k / depth.width) as f64]);
        let bare = -height / dot(normal, ray);
        let bare = if bare > 0.0 { bare } else { f64::INFINITY };
        let square = |z: f64| ((f64::from(seen) - z) / noise).powi(2).min(LIMIT);
        gain += square(bare) - square(f64::from(rope).min(bare));
    }
    gain
}

/// The depth that a view would see of the ropes alone; infinite where there are none.
fn rendered(view: &RopeView, correction: &[f64; 6], chains: &[Vec<Point>], radius: f64) -> Image<f32> {
    let [w, h] = view.size;
    let mut shown = Image::filled(w, h, f32::INFINITY);
    let [fu, fv] = view.pinhole.focal;
    for nodes in chains {
        let places: Vec<Point> = nodes.iter().map(|&x| view.corrected(correction, x)).collect();
        // ropes are cut flat
        let cuts = match places.as_slice() {
            [a, b, .., c, d] => [(*a, normalized(sub(*a, *b))), (*d, normalized(sub(*d, *c)))],
            _ => continue,
        };
        for pair in places.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let d: Point = std::array::from_fn(|k| b[k] - a[k]);
            let parts = (dot(d, d).sqrt() / (APART * radius)).ceil().max(1.0);
            for i in 0..=parts as usize {
                let ball: Point = std::array::from_fn(|k| a[k] + d[k] * i as f64 / parts);
                if ball[2] < radius + NEAREST {
                    continue;
                }
                // the outline of a ball is a little wider than its radius
                let near = ball[2] - radius;
                let [u, v] = view.projected(ball);
                let (du, dv) = (fu * radius / near, fv * radius / near);
                let columns = span(u - du, u + du, w);
                let beyond = dot(ball, ball) - radius * radius;
                let cut = cuts.iter().find(|(end, _)| squared_distance(*end, ball) < radius * radius);
                for y in span(v - dv, v + dv, h) {
                    for x in columns.clone() {
                        let ray = view.ray([x as f64, y as f64]);
                        let (square, along) = (dot(ray, ray), dot(ray, ball));
                        let inside = along * along - square * beyond;
                        if inside > 0.0 {
                            let z = (along - inside.sqrt()) / square;
                            let hit = ray.map(|x| x * z);
                            if cut.is_some_and(|(end, outward)| dot(sub(hit, *end), *outward) > 0.0) {
                                continue;
                            }
                            let to = &mut shown.values[y * w + x];
                            *to = to.min(z as f32);
                        }
                    }
                }
            }
        }
    }
    shown
}

/// The pixels from one place to another that are in the image.
fn span(from: f64, to: f64, count: usize) -> std::ops::Range<usize> {
    let first = from.ceil().max(0.0) as usize;
    let last = (to.floor() + 1.0).clamp(0.0, count as f64) as usize;
    first.min(last)..last
}

impl RopeView<'_> {
    /// The ray through a pixel's centre, camera frame, to a depth of one.
    #[inline]
    fn ray(&self, [u, v]: [f64; 2]) -> Point {
        let [fu, fv] = self.pinhole.focal;
        let [cu, cv] = self.pinhole.center;
        [(u - cu) / fu, (v - cv) / fv, 1.0]
    }

    /// A direction of the world in the corrected camera frame.
    fn untwisted(&self, correction: &[f64; 6], n: Point) -> Point {
        let r = &self.pose.rotation;
        let y: Point = std::array::from_fn(|k| r[(0, k)] * n[0] + r[(1, k)] * n[1] + r[(2, k)] * n[2]);
        let turn = cross([correction[0], correction[1], correction[2]], y);
        std::array::from_fn(|k| y[k] + turn[k])
    }

    /// How far the corrected camera is above a plane.
    fn height(&self, correction: &[f64; 6], plane: Plane) -> f64 {
        // the plane's point nearest to the camera, and where that lies in the corrected frame
        let centre: Point = self.pose.translation.into();
        let away = plane.height(centre);
        let foot: Point = std::array::from_fn(|k| centre[k] - away * plane.normal[k]);
        -dot(self.untwisted(correction, plane.normal), self.corrected(correction, foot))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Rope, view};
    use super::*;

    /// Depth that was made of a rope on a plane agrees with that rope more than with the rope moved aside.
    #[test]
    fn the_rope_that_made_the_depth_gains_most() {
        let rope = Rope::bent(0.004);
        let seen_by = view(std::slice::from_ref(&rope), [0.02, -0.15, 0.5], 0.3);
        let view = seen_by.rope_view();
        let plane = Plane { normal: [0.0, 0.0, 1.0], offset: rope.nodes[0][2] - 0.004 };
        let none = [0.0; 6];
        let chains = [rope.nodes.clone()];
        let mut depth = rendered(&view, &none, &chains, 0.004);
        let normal = view.untwisted(&none, plane.normal);
        let height = view.height(&none, plane);
        for (k, value) in depth.values.iter_mut().enumerate() {
            let ray = view.ray([(k % depth.width) as f64, (k / depth.width) as f64]);
            *value = value.min((-height / dot(normal, ray)) as f32);
        }
        let gain = |by: Point| {
            let moved: Vec<Point> = chains[0].iter().map(|p| std::array::from_fn(|k| p[k] + by[k])).collect();
            depth_gain(&view, &depth, &none, &[moved], 0.004, plane, 0.002)
        };
        let best = gain([0.0; 3]);
        assert!(best > 100.0, "{best}");
        for by in [[0.003, 0.0, 0.0], [0.0, 0.003, 0.0], [0.0, 0.0, 0.003], [0.1, 0.0, 0.0]] {
            assert!(gain(by) < 0.9 * best, "{by:?}: {} of {best}", gain(by));
        }
    }
}
