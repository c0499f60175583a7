//! Lines that enter capsules: rays, and the ways of spheres' centres.

use super::capsule::Capsule;
use crate::geometry::{Point, advance, cross, dot, squared_distance, sub};
use crate::index::bounds::Bounds;

/// A straight way from an origin.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    origin: Point,
    /// Unit vector; zero if the line has no length.
    direction: Point,
    /// The reciprocals of its coordinates.
    inverse: Point,
    /// Metres; infinite for a ray.
    length: f64,
}

impl Line {
    /// Makes a ray along a vector that is not zero.
    pub fn ray(origin: Point, direction: Point) -> Self {
        // scale by the largest coordinate, so that squares neither overflow nor underflow
        let largest = direction.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
        let direction = direction.map(|x| x / largest);
        let length = dot(direction, direction).sqrt();
        Self::new(origin, direction.map(|x| x / length), f64::INFINITY)
    }

    /// Makes the way from one place to another.
    pub fn between(start: Point, end: Point) -> Self {
        let step = sub(end, start);
        let length = dot(step, step).sqrt();
        let direction = if length > 0.0 { step.map(|x| x / length) } else { [0.0; 3] };
        Self::new(start, direction, length)
    }

    fn new(origin: Point, direction: Point, length: f64) -> Self {
        Self { origin, direction, inverse: direction.map(|x| 1.0 / x), length }
    }

    /// Unit vector.
    pub fn direction(&self) -> Point {
        self.direction
    }

    /// Returns the place at a distance from the origin.
    #[inline]
    pub fn at(&self, distance: f64) -> Point {
        advance(self.origin, distance, self.direction)
    }

    /// Returns a distance as a share of the length.
    #[inline]
    pub fn share(&self, distance: f64) -> f64 {
        if self.length > 0.0 { (distance / self.length).min(1.0) } else { 0.0 }
    }

    /// Returns the distance at which it enters a box, widened by some lengths on each side; infinite if it does not.
    #[inline]
    pub fn enters_box(&self, bounds: &Bounds, wider: Point) -> f64 {
        let (mut enters, mut leaves) = (0.0_f64, self.length);
        for k in 0..3 {
            let low = bounds.low[k] - wider[k] - self.origin[k];
            let high = bounds.high[k] + wider[k] - self.origin[k];
            if self.inverse[k].is_infinite() {
                if low > 0.0 || high < 0.0 {
                    return f64::INFINITY;
                }
                continue;
            }
            let (one, other) = (low * self.inverse[k], high * self.inverse[k]);
            enters = enters.max(one.min(other));
            leaves = leaves.min(one.max(other));
        }
        if enters <= leaves { enters } else { f64::INFINITY }
    }

    /// Returns the distance at which it enters a capsule, widened by some length; 0 if it starts inside.
    #[inline]
    pub fn enters(&self, capsule: &Capsule, wider: f64) -> Option<f64> {
        let radius = capsule.radius + wider;
        let starts_inside = || (capsule.squared_distance(self.origin) <= radius * radius).then_some(0.0);
        if self.length == 0.0 {
            return starts_inside();
        }
        // from the place beside the capsule's middle, so that no precision is lost at distant origins
        let beside = dot(sub(capsule.at(0.5 * capsule.length), self.origin), self.direction);
        let place = self.at(beside);
        let from_start = sub(place, capsule.start);
        let (pace, along) = (dot(self.direction, capsule.along), dot(from_start, capsule.along));
        let across = advance(self.direction, -pace, capsule.along);
        let off = advance(from_start, -along, capsule.along);
        // the wall: |off + t across|² = radius², by its first root without cancellation
        let (a, b, c) = (dot(across, across), dot(across, off), dot(off, off) - radius * radius);
        let aside = cross(across, off);
        let square = a * radius * radius - dot(aside, aside);
        if square < 0.0 {
            return None;
        }
        let root = square.sqrt();
        let t = if b > 0.0 { -(b + root) / a } else { c / (root - b) };
        let at_wall = along + t * pace;
        let t = if (0.0..=capsule.length).contains(&at_wall) {
            t
        } else {
            // the ball at the end that comes first
            let last = at_wall > capsule.length || (at_wall.is_nan() && pace < 0.0);
            let off = sub(place, if last { capsule.at(capsule.length) } else { capsule.start });
            let nearest = -dot(off, self.direction);
            let square = radius * radius - squared_distance(advance(off, nearest, self.direction), [0.0; 3]);
            if square < 0.0 {
                return None;
            }
            nearest - square.sqrt()
        };
        let distance = beside + t;
        if distance < 0.0 {
            return starts_inside();
        }
        (distance <= self.length).then_some(distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lines_enter_capsules_where_the_distance_falls_to_the_radius(
            ends in prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0)), radius in 0.05f64..0.5,
            kind in 0..4, far in 0..3,
        ) {
            let [a, b, mut origin, mut end] = ends;
            match kind {
                // along the axis' direction, and along a coordinate
                1 => end = advance(origin, 3.0, sub(b, a)),
                2 => end = [origin[0], origin[1], 2.0],
                _ => {}
            }
            let direction = sub(end, origin);
            origin = advance(origin, -(10f64.powi(3 * far) - 1.0), direction);
            let capsule = Capsule::new([a, b], [0.0, 1.0], radius, 0).unwrap();
            let line = Line::ray(origin, direction);
            let least = capsule.approach(origin, direction.map(|x| x * 1e7)).squared.sqrt();
            let rounding = 1e-13 * 10f64.powi(3 * far);
            let Some(distance) = line.enters(&capsule, 0.0) else {
                prop_assert!(least > radius - 1e-8, "{least} {radius}");
                return Ok(());
            };
            let there = capsule.squared_distance(line.at(distance)).sqrt();
            if distance == 0.0 {
                prop_assert!(there <= radius);
            } else {
                prop_assert!((there - radius).abs() < 10.0 * rounding.max(1e-13), "{there} {radius}");
                // the way in, not out
                let before = capsule.squared_distance(line.at(distance - 1e-3)).sqrt();
                prop_assert!(before > radius - 1e-9);
            }
            let bounds = Bounds {
                low: std::array::from_fn(|k| a[k].min(b[k])), high: std::array::from_fn(|k| a[k].max(b[k])),
            };
            prop_assert!(line.enters_box(&bounds, [radius; 3]) <= distance + rounding);
            let reach = line.share(distance);
            prop_assert_eq!(reach, 0.0);
        }
    }

    #[test]
    fn lines_along_an_axis_enter_at_the_nearer_end() {
        let capsule = Capsule::new([[0.0; 3], [1.0, 0.0, 0.0]], [0.0, 1.0], 0.25, 0).unwrap();
        for side in [0.0, 0.25] {
            let there = Line::ray([-2.0, side, 0.0], [7.0, 0.0, 0.0]).enters(&capsule, 0.0);
            assert_eq!(there, Some(2.0 - if side == 0.0 { 0.25 } else { 0.0 }));
            let back = Line::ray([3.0, side, 0.0], [-1e-200, 0.0, 0.0]).enters(&capsule, 0.0);
            assert_eq!(back, Some(2.0 - if side == 0.0 { 0.25 } else { 0.0 }));
        }
        assert_eq!(Line::ray([-2.0, 0.26, 0.0], [1.0, 0.0, 0.0]).enters(&capsule, 0.0), None);
        assert_eq!(Line::ray([-2.0, 0.0, 0.0], [-1.0, 0.0, 0.0]).enters(&capsule, 0.0), None);
        assert_eq!(Line::between([-2.0, 0.0, 0.0], [-0.5, 0.0, 0.0]).enters(&capsule, 0.25), Some(1.5));
        assert_eq!(Line::between([-2.0, 0.0, 0.0], [-0.51, 0.0, 0.0]).enters(&capsule, 0.25), None);
        let still = [0.5, 0.25, 0.0];
        assert_eq!(Line::between(still, still).enters(&capsule, 0.0), Some(0.0));
        assert_eq!(
            Line::between(still, still).enters_box(&Bounds { low: still, high: still }, [0.0; 3]),
            0.0
        );
    }
}
