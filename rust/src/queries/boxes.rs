//! Moving and turning boxes against capsules.
//!
//! A plane between a box and an axis bounds their distance from below while the box moves. Each corner's place along
//! the plane's normal is known to the second order in time, with a bound on the rest. Steps by these bounds, as in
//! conservative advancement (Mirtich 1996), never step over a contact.

use nalgebra::{Rotation3, Unit, UnitQuaternion, Vector3};

use super::capsule::Capsule;
use super::least::least_place;
use super::rays::Line;
use crate::geometry::{Point, RigidMotion, advance, cross, dot};

/// Steps for one capsule at most; only rounding can reach this. The rest of the motion then counts as contact, or as near
/// as its bound.
const MAX_STEPS: usize = 10_000;
const CHORDS: usize = 3; // improvements of a step's length
const MAX_OPEN: usize = 80; // open intervals of time at most; there are fewer, because intervals are halved
const BRIEF: f64 = 1e-12; // shorter intervals of time are not divided, shares of the motion
const NEAR: f64 = 1e-6; // slack of a contact, metres
const OF_TURN: f64 = 1e-5; // slack of a contact, shares of the corners' way by turning

/// Finds the place of a segment, from 0 to 1, that is nearest to an axis-aligned box around the origin; returns it and
/// the vector from the box to it.
#[inline]
pub fn segment_to_box(start: Point, step: Point, half: Point) -> (f64, Point) {
    let beyond = |place: f64| -> Point {
        std::array::from_fn(|k| {
            let x = start[k] + place * step[k];
            x - x.clamp(-half[k], half[k])
        })
    };
    let at = |k: usize, side: f64| (side * half[k] - start[k]) / step[k];
    let breaks = [at(0, -1.0), at(0, 1.0), at(1, -1.0), at(1, 1.0), at(2, -1.0), at(2, 1.0)];
    let place = least_place(|place| dot(step, beyond(place)), breaks);
    (place, beyond(place))
}

/// A box whose centre moves straight and evenly from one pose's to another's. It turns evenly about one axis, the
/// shorter way round.
#[derive(Debug, Clone)]
pub struct BoxMotion {
    start: RigidMotion,
    half: Point,
    step: Vector3<f64>,
    axis: Unit<Vector3<f64>>,
    angle: f64,
    /// The axis of the turn in the box's frame; its length is the angle.
    turning: Point,
    /// The way of a corner by turning, at most.
    turn: f64,
    /// The way of its centre.
    pub line: Line,
    /// The box's reach from its centre along each axis, slack included.
    pub reach: Point,
}

/// A box's position relative to a capsule's axis at one time.
#[derive(Debug, Clone, Copy)]
pub struct Gap {
    /// Distance of the box from the axis, metres.
    distance: f64,
    /// The nearest place of the axis, metres from its start.
    pub along: f64,
    /// Unit vector from the box to that place, in the box's frame, and its rate of change there.
    normal: Point,
    tilt: Point,
    /// Motion of the box's centre along that vector, metres over the whole time.
    closing: f64,
}

impl BoxMotion {
    /// Moves a box from one pose to another.
    pub fn new(start: &RigidMotion, end: &RigidMotion, half: Point) -> Self {
        let step = end.translation - start.translation;
        let between = Rotation3::from_matrix_unchecked(end.rotation * start.rotation.transpose());
        let turned = UnitQuaternion::from_rotation_matrix(&between).axis_angle();
        // poses that differ only by rounding do not turn
        let still = (end.rotation - start.rotation).amax() < 1e-14;
        let (axis, angle) = turned.filter(|_| !still).unwrap_or((Vector3::x_axis(), 0.0));
        let mine = start.rotation.transpose() * axis.into_inner();
        let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
        let from_axis =
            corners.map(|[y, z]| mine.cross(&Vector3::new(half[0], y * half[1], z * half[2])).norm());
        let turn = angle * from_axis.into_iter().fold(0.0, f64::max);
        let slack = NEAR + OF_TURN * turn;
        let reach = if angle == 0.0 {
            start.rotation.abs() * Vector3::from(half)
        } else {
            Vector3::repeat(dot(half, half).sqrt())
        };
        Self {
            start: *start,
            half,
            step,
            axis,
            angle,
            turning: (mine * angle).into(),
            turn,
            line: Line::between(start.translation.into(), end.translation.into()),
            reach: reach.map(|x| x + slack).into(),
        }
    }

    /// Contacts are early, and clearances small, by at most this, metres.
    pub fn slack(&self) -> f64 {
        NEAR + OF_TURN * self.turn
    }

    /// The start of its centre, and the vector to the end.
    pub fn way(&self) -> (Point, Point) {
        (self.start.translation.into(), self.step.into())
    }

    /// Returns its position relative to a capsule at a time from 0 to 1.
    pub fn nearest(&self, time: f64, capsule: &Capsule) -> Gap {
        let turned = match self.angle {
            0.0 => self.start.rotation,
            angle => Rotation3::from_axis_angle(&self.axis, time * angle).into_inner() * self.start.rotation,
        };
        let into_box = turned.transpose();
        let from_center = Vector3::from(capsule.start) - (self.start.translation + self.step * time);
        let along = into_box * (Vector3::from(capsule.along) * capsule.length);
        let (place, off) = segment_to_box((into_box * from_center).into(), along.into(), self.half);
        let distance = dot(off, off).sqrt();
        let normal = if distance > 0.0 { off.map(|x| x / distance) } else { [0.0; 3] };
        let closing = dot(normal, (into_box * self.step).into());
        Gap { distance, along: place * capsule.length, normal, tilt: cross(normal, self.turning), closing }
    }

    /// Bounds how much nearer to the axis the box may be after some time; convex, and 0 at first.
    #[inline]
    fn nearing(&self, gap: &Gap, time: f64) -> f64 {
        let support = |direction: Point| -> f64 { (0..3).map(|k| self.half[k] * direction[k].abs()).sum() };
        let leaning = support(advance(gap.normal, time, gap.tilt)) - support(gap.normal);
        leaning + gap.closing * time + 0.5 * self.turn * self.angle * time * time
    }

    /// Returns the first time from 0 to `latest` at which a capsule is nearer than the slack.
    pub fn first_contact(&self, capsule: &Capsule, latest: f64) -> Option<f64> {
        let mut time = 0.0;
        for _ in 0..MAX_STEPS {
            let gap = self.nearest(time, capsule);
            let apart = gap.distance - capsule.radius;
            if apart <= self.slack() {
                return Some(time);
            }
            let left = latest - time;
            let over = self.nearing(&gap, left) - apart;
            if over <= 0.0 {
                return None;
            }
            // a chord of a convex function crosses zero earlier than the function
            let (mut step, mut under) = (0.0, -apart);
            for _ in 0..CHORDS {
                step += (left - step) * (under / (under - over));
                under = self.nearing(&gap, step) - apart;
                if under >= 0.0 {
                    break;
                }
            }
            let next = time + step;
            if next == time {
                break;
            }
            time = next;
        }
        Some(time)
    }

    /// Returns the least distance from a capsule's surface during the motion, at most the slack too small, and its
    /// time.
    ///
    /// It returns `best` if no distance is less. If the axis enters the box, the distance is minus the radius. Where
    /// rounding exceeds the slack, the answer is smaller.
    pub fn clearance(&self, capsule: &Capsule, best: f64) -> (f64, f64) {
        let deepest = -capsule.radius;
        let mut upper = (f64::INFINITY, 0.0);
        let mut ask = |time: f64| {
            let gap = self.nearest(time, capsule);
            let apart = gap.distance - capsule.radius;
            if apart < upper.0 {
                upper = (apart, time);
            }
            (gap, apart, upper)
        };
        let (mut found, mut least) = (f64::INFINITY, (f64::INFINITY, 0.0));
        let mut open = [(0.0, 1.0); MAX_OPEN];
        let mut count = usize::from(best > deepest);
        let mut steps = 0;
        while count > 0 {
            count -= 1;
            steps += 1;
            let (from, to) = open[count];
            let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
            let (gap, apart, mut upper) = ask(middle);
            if apart <= deepest {
                return (apart, middle);
            }
            let (back, ahead) = (self.nearing(&gap, -half), self.nearing(&gap, half));
            let lowest = (apart - back.max(ahead).max(0.0)).max(deepest);
            if lowest < best && half == 0.5 {
                ask(from);
                upper = ask(to).2;
            }
            least = upper;
            if lowest >= least.0.min(best) {
                continue;
            }
            if least.0 - lowest <= self.slack() || half < BRIEF || steps > MAX_STEPS {
                found = found.min(lowest);
                continue;
            }
            // the half that may be nearer comes first
            let halves = [(from, middle), (middle, to)];
            let nearer = usize::from(ahead > back);
            open[count] = halves[1 - nearer];
            open[count + 1] = halves[nearer];
            count += 2;
        }
        (found.min(least.0), least.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::sub;
    use proptest::prelude::*;

    fn pose(turn: Point, place: Point) -> RigidMotion {
        let rotation = Rotation3::new(Vector3::from(turn)).into_inner();
        RigidMotion { rotation, translation: place.into() }
    }

    #[test]
    fn steps_end_where_rounding_exceeds_the_slack() {
        // along an axis a few metres beside it, so far from the origin that coordinates are multiples of 1/64 m
        let turn = [0.3, -0.5, 0.7];
        let start = pose(turn, [5e13, -9e13, 2e13]);
        let (center, along) = (start.translation, start.rotation * Vector3::new(0.0, 1e11, 0.0));
        let end = pose([turn[0] + 1e-5, turn[1], turn[2]], (center + along).into());
        let beside = center + start.rotation * Vector3::new(35.0, 0.0, 0.0);
        let ends: [Point; 2] = [(beside - along).into(), (beside + along).into()];
        let length = dot(sub(ends[1], ends[0]), sub(ends[1], ends[0])).sqrt();
        let capsule = Capsule::new(ends, [0.0, length], 0.1, 0).unwrap();
        let motion = BoxMotion::new(&start, &end, [32.0, 21.0, 65.0]);
        let (clearance, _) = motion.clearance(&capsule, f64::INFINITY);
        let apart = |k: u32| motion.nearest(f64::from(k) / 1000.0, &capsule).distance - capsule.radius;
        assert!((-capsule.radius..=(0..=1000).map(apart).fold(f64::INFINITY, f64::min)).contains(&clearance));
    }

    proptest! {
        #[test]
        fn segments_are_nearest_to_boxes_where_many_places_say_so(
            start in prop::array::uniform3(-2.0f64..2.0), step in prop::array::uniform3(-3.0f64..3.0),
            half in prop::array::uniform3(0.0f64..1.0), flat in 0..4usize,
        ) {
            let mut step = step;
            if flat < 3 {
                step[flat] = 0.0;
            }
            let (place, off) = segment_to_box(start, step, half);
            let beyond = |place: f64| -> Point {
                std::array::from_fn(|k| (start[k] + place * step[k]).abs() - half[k]).map(|x: f64| x.max(0.0))
            };
            let distance = |place: f64| dot(beyond(place), beyond(place)).sqrt();
            prop_assert!((0.0..=1.0).contains(&place));
            prop_assert!((dot(off, off).sqrt() - distance(place)).abs() < 1e-15);
            for k in 0..=1000 {
                prop_assert!(distance(place) <= distance(f64::from(k) / 1000.0) + 1e-12);
            }
        }

        #[test]
        fn boxes_are_never_nearer_than_the_bound_says(
            turns in prop::array::uniform2(prop::array::uniform3(-2.0f64..2.0)),
            places in prop::array::uniform2(prop::array::uniform3(-1.0f64..1.0)),
            half in prop::array::uniform3(0.0f64..0.5), from in 0.0f64..1.0,
        ) {
            let motion = BoxMotion::new(&pose(turns[0], places[0]), &pose(turns[1], places[1]), half);
            let capsule = Capsule::new([[1.0, 0.2, -0.3], [0.6, -0.7, 0.5]], [0.0, 1.0], 0.1, 0).unwrap();
            let gap = motion.nearest(from, &capsule);
            // rounding turns the normal by this much, times lengths of about 1 m; arbitrarily if the axis is in the box
            let rounding = 1e-12 + 1e-15 / gap.distance;
            let distances = (0..=400).map(|k| f64::from(k) / 400.0).map(|t| (t, motion.nearest(t, &capsule).distance));
            let distances: Vec<(f64, f64)> = distances.collect();
            for &(time, distance) in &distances {
                prop_assert!(distance >= gap.distance - motion.nearing(&gap, time - from) - rounding);
            }
            let least = distances.iter().fold(f64::INFINITY, |least, d| least.min(d.1)) - capsule.radius;
            let (clearance, _) = motion.clearance(&capsule, f64::INFINITY);
            prop_assert!(clearance <= least + 1e-12);
            let speed = dot(motion.step.into(), motion.step.into()).sqrt() + motion.turn;
            prop_assert!(clearance >= least - motion.slack() - speed / 800.0);
            let contact = motion.first_contact(&capsule, 1.0);
            let seen = distances.iter().find(|d| d.1 <= capsule.radius);
            prop_assert!(seen.is_none_or(|seen| contact.is_some_and(|time| time <= seen.0)));
            if let Some(time) = contact {
                prop_assert!(motion.nearest(time, &capsule).distance <= capsule.radius + motion.slack());
            }
        }
    }
}
