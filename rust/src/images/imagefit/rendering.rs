//! Agreement of depth with ropes on a plane, compared with the bare plane.

use super::camera::{Plane, RopeView};
use crate::geometry::{Point, cross, dot, normalized, squared_distance, sub};
use crate::images::image::Image;
use crate::images::runs::list_between;

const LIMIT: f64 = 9.0; // limit of a squared residual over the noise
const SPACING: f64 = 0.25; // distance between the balls that a tube is drawn with, radii
const MIN_DEPTH: f64 = 1e-3; // depth of what a camera sees at least, metres

/// One view's depth, and what it is compared with.
pub struct DepthScene<'a> {
    pub view: &'a RopeView<'a>,
    pub depth: &'a Image<f32>,
    /// Turns and moves the camera frame.
    pub correction: &'a [f64; 6],
    /// The ropes' radius, metres.
    pub radius: f64,
    pub plane: Plane,
    /// Standard deviation of depth, metres.
    pub noise: f64,
}

impl DepthScene<'_> {
    /// Returns twice the log of how much more likely the depths are with the ropes than with the bare plane.
    ///
    /// It sums over the pixels how much smaller the squared residual over the noise is with ropes. Each square is
    /// limited, and errors count as independent.
    pub fn gain(&self, chains: &[Vec<Point>]) -> f64 {
        let (shown, part) = self.rendered(chains);
        self.gain_within(&shown, part)
    }

    /// As [`DepthScene::gain`], for several ends of one rope, up to a common constant.
    pub fn gains_of_ends(&self, chains: &[Vec<Point>], ends: &[Vec<Point>]) -> Vec<f64> {
        let (shown, _) = self.rendered(chains);
        let drawn: Vec<(Image<f32>, Part)> = ends
            .iter()
            .map(|end| {
                let mut shown = shown.clone();
                let part = self.draw(&mut shown, end);
                (shown, part)
            })
            .collect();
        let all = drawn.iter().fold(Part::NONE, |all, (_, part)| all.with(*part));
        drawn.iter().map(|(shown, _)| self.gain_within(shown, all)).collect()
    }

    fn gain_within(&self, shown: &Image<f32>, part: Part) -> f64 {
        let Self { view, correction, plane, noise, .. } = *self;
        let (normal, height) = (view.untwisted(correction, plane.normal), view.height(correction, plane));
        let mut gain = 0.0;
        for y in part.rows[0]..part.rows[1] {
            for x in part.columns[0]..part.columns[1] {
                let (rope, seen) = (shown.at(x, y), self.depth.at(x, y));
                if rope == f32::INFINITY || seen.is_nan() || seen <= 0.0 {
                    continue;
                }
                let bare = -height / dot(normal, view.ray([x as f64, y as f64]));
                let bare = if bare > 0.0 { bare } else { f64::INFINITY };
                let square = |z: f64| ((f64::from(seen) - z) / noise).powi(2).min(LIMIT);
                gain += square(bare) - square(f64::from(rope).min(bare));
            }
        }
        gain
    }

    /// Renders the depth of ropes alone, infinite where there are none; also returns the part of the image with ropes.
    fn rendered(&self, chains: &[Vec<Point>]) -> (Image<f32>, Part) {
        let [w, h] = self.view.size;
        let mut shown = Image::filled(w, h, f32::INFINITY);
        let part = chains.iter().fold(Part::NONE, |all, nodes| all.with(self.draw(&mut shown, nodes)));
        (shown, part)
    }

    /// Draws a rope in front of the image so far, as balls in a row, cut flat at its ends.
    fn draw(&self, shown: &mut Image<f32>, nodes: &[Point]) -> Part {
        let Self { view, correction, radius, .. } = *self;
        let [w, h] = view.size;
        let [fu, fv] = view.pinhole.focal;
        let places: Vec<Point> = nodes.iter().map(|&x| view.corrected(correction, x)).collect();
        let mut part = Part::NONE;
        let cuts = match places.as_slice() {
            [a, b, .., c, d] => [(*a, normalized(sub(*a, *b))), (*d, normalized(sub(*d, *c)))],
            [a, b] => [(*a, normalized(sub(*a, *b))), (*b, normalized(sub(*b, *a)))],
            _ => return part,
        };
        for pair in places.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let d: Point = std::array::from_fn(|k| b[k] - a[k]);
            let parts = (dot(d, d).sqrt() / (SPACING * radius)).ceil().max(1.0);
            for i in 0..=parts as usize {
                let ball: Point = std::array::from_fn(|k| a[k] + d[k] * i as f64 / parts);
                if ball[2] < radius + MIN_DEPTH {
                    continue;
                }
                // the outline of a ball is slightly wider than its radius
                let near = ball[2] - radius;
                let [u, v] = view.projected(ball);
                let (du, dv) = (fu * radius / near, fv * radius / near);
                let (columns, rows) = (list_between(u - du, u + du, w), list_between(v - dv, v + dv, h));
                if columns.is_empty() || rows.is_empty() {
                    continue;
                }
                part =
                    part.with(Part { columns: [columns.start, columns.end], rows: [rows.start, rows.end] });
                let beyond = dot(ball, ball) - radius * radius;
                let cut = cuts.iter().find(|(end, _)| squared_distance(*end, ball) < radius * radius);
                for y in rows {
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
        part
    }
}

/// A part of an image: the first column and the one after the last, and the same for rows.
#[derive(Debug, Clone, Copy)]
struct Part {
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Part {
    const NONE: Self = Self { columns: [usize::MAX, 0], rows: [usize::MAX, 0] };

    /// Returns the smallest part that holds both.
    fn with(self, other: Self) -> Self {
        let both = |a: [usize; 2], b: [usize; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self { columns: both(self.columns, other.columns), rows: both(self.rows, other.rows) }
    }
}

impl RopeView<'_> {
    /// Returns the ray through a pixel's centre to a depth of one, camera frame.
    #[inline]
    fn ray(&self, [u, v]: [f64; 2]) -> Point {
        let [fu, fv] = self.pinhole.focal;
        let [cu, cv] = self.pinhole.center;
        [(u - cu) / fu, (v - cv) / fv, 1.0]
    }

    /// Turns a direction of the world to the corrected camera frame.
    fn untwisted(&self, correction: &[f64; 6], n: Point) -> Point {
        let r = &self.pose.rotation;
        let y: Point = std::array::from_fn(|k| r[(0, k)] * n[0] + r[(1, k)] * n[1] + r[(2, k)] * n[2]);
        let turn = cross([correction[0], correction[1], correction[2]], y);
        std::array::from_fn(|k| y[k] + turn[k])
    }

    /// Returns the height of the corrected camera above a plane.
    fn height(&self, correction: &[f64; 6], plane: Plane) -> f64 {
        // the plane's point nearest to the camera, moved to the corrected frame
        let center: Point = self.pose.translation.into();
        let away = plane.height(center);
        let foot: Point = std::array::from_fn(|k| center[k] - away * plane.normal[k]);
        -dot(self.untwisted(correction, plane.normal), self.corrected(correction, foot))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Image as View, Rope, view};
    use super::*;

    const STILL: [f64; 6] = [0.0; 6];

    /// Returns a rope, its image, and the table that it lies on.
    fn rope_on_a_table() -> (Rope, View, Plane) {
        let rope = Rope::bent(0.004);
        let seen_by = view(std::slice::from_ref(&rope), [0.02, -0.15, 0.5], 0.3);
        let plane = Plane { normal: [0.0, 0.0, 1.0], offset: rope.nodes[0][2] - 0.004 };
        (rope, seen_by, plane)
    }

    fn scene<'a>(view: &'a RopeView<'a>, depth: &'a Image<f32>, plane: Plane) -> DepthScene<'a> {
        DepthScene { view, depth, correction: &STILL, radius: 0.004, plane, noise: 0.002 }
    }

    /// Returns the depth of a rope on a plane.
    fn depth_of(rope: &Rope, view: &RopeView<'_>, plane: Plane) -> Image<f32> {
        let nothing = Image::filled(0, 0, 0.0f32);
        let (mut depth, _) = scene(view, &nothing, plane).rendered(std::slice::from_ref(&rope.nodes));
        let (normal, height) = (view.untwisted(&STILL, plane.normal), view.height(&STILL, plane));
        for (k, value) in depth.values.iter_mut().enumerate() {
            let ray = view.ray([(k % depth.width) as f64, (k / depth.width) as f64]);
            *value = value.min((-height / dot(normal, ray)) as f32);
        }
        depth
    }

    /// Depth made of a rope on a plane agrees more with that rope than with the rope moved aside.
    #[test]
    fn the_rope_that_made_the_depth_gains_most() {
        let (rope, seen_by, plane) = rope_on_a_table();
        let view = seen_by.rope_view();
        let depth = depth_of(&rope, &view, plane);
        let gain = |by: Point| {
            let moved: Vec<Point> =
                rope.nodes.iter().map(|p| std::array::from_fn(|k| p[k] + by[k])).collect();
            scene(&view, &depth, plane).gain(&[moved])
        };
        let best = gain([0.0; 3]);
        assert!(best > 100.0, "{best}");
        for by in [[0.003, 0.0, 0.0], [0.0, 0.003, 0.0], [0.0, 0.0, 0.003], [0.1, 0.0, 0.0]] {
            assert!(gain(by) < 0.9 * best, "{by:?}: {} of {best}", gain(by));
        }
    }

    /// An end that continues as the rope did gains most; what lies before the ends does not count.
    #[test]
    fn the_end_that_made_the_depth_gains_most() {
        let (rope, seen_by, plane) = rope_on_a_table();
        let view = seen_by.rope_view();
        let depth = depth_of(&rope, &view, plane);
        let scene = scene(&view, &depth, plane);
        let count = rope.nodes.len();
        let stem = rope.nodes[..count - 60].to_vec();
        let ends: Vec<Vec<Point>> =
            [0, 20, 40].iter().map(|&less| rope.nodes[count - 61..count - less].to_vec()).collect();
        let gains = scene.gains_of_ends(std::slice::from_ref(&stem), &ends);
        assert!(gains[0] > gains[1] && gains[1] > gains[2], "{gains:?}");
        let whole = scene.gain(std::slice::from_ref(&rope.nodes));
        let shorter = scene.gain(&[rope.nodes[..count - 20].to_vec()]);
        assert!(
            (whole - shorter - (gains[0] - gains[1])).abs() < 0.02 * whole,
            "{whole} {shorter} {gains:?}"
        );
    }
}
