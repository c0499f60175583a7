//! A capsule: everything within a radius of a segment of a chain's axis.

use super::least::least_place;
use crate::geometry::{Point, advance, dot, squared_distance, sub};

/// A place on a chain's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    pub chain: usize,
    /// Arc length, metres.
    pub s: f64,
    pub point: Point,
}

/// A segment of an axis and its radius.
#[derive(Debug, Clone, Copy)]
pub struct Capsule {
    pub start: Point,
    /// Unit vector.
    pub along: Point,
    pub length: f64,
    pub radius: f64,
    /// Arc length at its start, and arc length for each metre.
    arc: f64,
    pace: f64,
    chain: u32,
    /// Its number among the capsules of all chains.
    pub number: u32,
}

/// The nearest approach of a moving point to a capsule's axis.
#[derive(Debug, Clone, Copy)]
pub struct Approach {
    /// The squared distance, m².
    pub squared: f64,
    /// The place of the axis, metres from its start.
    pub along: f64,
    /// The time, from 0 to 1.
    pub time: f64,
}

impl Capsule {
    /// Makes the capsule around a segment; None if the segment has no length.
    pub fn new(ends: [Point; 2], arc: [f64; 2], radius: f64, chain: usize) -> Option<Self> {
        let step = sub(ends[1], ends[0]);
        let length = dot(step, step).sqrt();
        (length > 0.0).then(|| Self {
            start: ends[0],
            along: step.map(|x| x / length),
            length,
            radius,
            arc: arc[0],
            pace: (arc[1] - arc[0]) / length,
            chain: chain as u32,
            number: 0,
        })
    }

    /// Returns the place of its axis at a distance from the start, metres.
    #[inline]
    pub fn at(&self, along: f64) -> Point {
        advance(self.start, along, self.along)
    }

    /// Returns the place of its axis nearest to a point, metres from the start.
    #[inline]
    pub fn foot(&self, point: Point) -> f64 {
        dot(sub(point, self.start), self.along).clamp(0.0, self.length)
    }

    /// Returns the squared distance of a point from its axis.
    #[inline]
    pub fn squared_distance(&self, point: Point) -> f64 {
        squared_distance(point, self.at(self.foot(point)))
    }

    /// Finds the nearest approach of a point that moves straight and evenly.
    #[inline]
    pub fn approach(&self, start: Point, step: Point) -> Approach {
        let at = |time: f64| advance(start, time, step);
        let slope = |time: f64| {
            let point = at(time);
            dot(step, sub(point, self.at(self.foot(point))))
        };
        let (beside, pace) = (dot(sub(start, self.start), self.along), dot(step, self.along));
        let time = least_place(slope, [-beside / pace, (self.length - beside) / pace]);
        let point = at(time);
        let along = self.foot(point);
        Approach { squared: squared_distance(point, self.at(along)), along, time }
    }

    /// Returns a place of its axis as a place of the chain.
    pub fn place(&self, along: f64) -> Place {
        Place { chain: self.chain as usize, s: self.arc + self.pace * along, point: self.at(along) }
    }

    /// Returns the place of its axis nearest to a point.
    pub fn beside(&self, point: Point) -> Place {
        self.place(self.foot(point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn segments_are_nearest_where_many_places_of_both_say_so(
            ends in prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0)), parallel in any::<bool>(),
        ) {
            let [a, b, start, mut step] = ends;
            if parallel {
                step = sub(b, a);
            }
            let capsule = Capsule::new([a, b], [3.0, 5.0], 0.1, 7).unwrap();
            let found = capsule.approach(start, step);
            let least = (0..=2000)
                .map(|k| capsule.squared_distance(advance(start, f64::from(k) / 2000.0, step)))
                .fold(f64::INFINITY, f64::min)
                .sqrt();
            let size = dot(step, step).sqrt();
            prop_assert!(found.squared.sqrt() <= least + 1e-12);
            prop_assert!(found.squared.sqrt() >= least - size / 4000.0);
            let place = capsule.place(found.along);
            prop_assert!(place.chain == 7 && (3.0..=5.0 + 1e-12).contains(&place.s));
            let apart = squared_distance(place.point, advance(start, found.time, step));
            prop_assert!((apart - found.squared).abs() < 1e-12);
        }
    }
}
