//! Boxes that move and turn, against capsules.
//!
//! A plane between a box and an axis bounds their distance from below while the box moves: for each corner its place
//! along the plane's normal is known to the second order in time, with a bound on the rest. Steps by such bounds, as in
//! conservative advancement (Mirtich 1996), never step over a contact.

use nalgebra::{Rotation3, Unit, UnitQuaternion, Vector3};

use super::capsule::Capsule;
use super::least::least_place;
use super::rays::Line;
use crate::geometry::{Point, RigidMotion, advance, cross, dot};

/// A bound on steps, which rounding alone can reach; what is left open then counts as contact.
const MOST: usize = 10_000;
/// So often a step's length is improved.
const CHORDS: usize = 3;
/// Stretches of time that are left are halved, so they are not as many.
const OPEN: usize = 80;
/// Shorter stretches of time are not divided.
const BRIEF: f64 = 1e-12;
/// How much too early a contact is: metres, and of the way that corners turn.
const NEAR: f64 = 1e-6;
const OF_TURN: f64 = 1e-5;

/// The place of a segment that is nearest to a box around the origin along the axes, from 0 to 1, and the vector to it from
/// the box.
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

/// A box whose centre moves straight and evenly from one pose's to another's, while it turns evenly about one axis, the
/// shorter way round.
#[derive(Debug, Clone)]
pub struct BoxMotion {
    start: RigidMotion,
    half: Point,
    step: Vector3<f64>,
    axis: Unit<Vector3<f64>>,
    angle: f64,
    /// The axis in the box' frame, as long as the angle.
    turning: Point,
    /// How far a corner moves at most by turning.
    turn: f64,
    /// The way of its centre.
    pub line: Line,
    /// How far it reaches from its centre along each axis, slack and all.
    pub reach: Point,
}

/// How a box stands to a capsule's axis at a time.
#[derive(Debug, Clone, Copy)]
pub struct Gap {
    /// Of the box from the axis, metres.
    distance: f64,
    /// The nearest place of the axis, metres from its start.
    pub along: f64,
    /// Unit vector from the box to that place, and how it changes as the box sees it, in the box' frame.
    normal: Point,
    tilt: Point,
    /// How fast the box' centre moves along it, metres in all the time.
    closing: f64,
}

impl BoxMotion {
    /// From a pose to another.
    pub fn new(start: &RigidMotion, end: &RigidMotion, half: Point) -> Self {
        let step = end.translation - start.translation;
        let between = Rotation3::from_matrix_unchecked(end.rotation * start.rotation.transpose());
        let turned = UnitQuaternion::from_rotation_matrix(&between).axis_angle();
        // poses that differ by rounding alone turn nothing
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

    /// How much too early a contact, and how much too small a clearance is at most, metres.
    pub fn slack(&self) -> f64 {
        NEAR + OF_TURN * self.turn
    }

    /// Where its centre is at first, and how far that moves.
    pub fn way(&self) -> (Point, Point) {
        (self.start.translation.into(), self.step.into())
    }

    /// How it stands to a capsule at a time from 0 to 1.
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

    /// How much nearer the box may be to the axis when so much time is over; convex, and 0 if it is none.
    #[inline]
    fn nearing(&self, gap: &Gap, time: f64) -> f64 {
        let support = |direction: Point| -> f64 { (0..3).map(|k| self.half[k] * direction[k].abs()).sum() };
        let leaning = support(advance(gap.normal, time, gap.tilt)) - support(gap.normal);
        leaning + gap.closing * time + 0.5 * self.turn * self.angle * time * time
    }

    /// The first time from 0 to `latest` at which a capsule is nearer than the slack.
    pub fn first_contact(&self, capsule: &Capsule, latest: f64) -> Option<f64> {
        let mut time = 0.0;
        for _ in 0..MOST {
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
            // chords of a convex function cross its zero before it does
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

    /// The least distance from a capsule's surface on the whole way, at most the slack too small, and the time of it; not
    /// less than `best` if it is none that is less. The axis in the box is as deep as can be.
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
        let mut open = [(0.0, 1.0); OPEN];
        let mut count = usize::from(best > deepest);
        while count > 0 {
            count -= 1;
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
            if least.0 - lowest <= self.slack() || half < BRIEF {
                found = found.min(lowest);
                continue;
            }
            // the half that may be nearer first
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
    use proptest::prelude::*;

    fn pose(turn: Point, place: Point) -> RigidMotion {
        let rotation = Rotation3::new(Vector3::from(turn)).into_inner();
        RigidMotion { rotation, translation: place.into() }
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
            // rounding turns the normal by so much, times lengths of about 1 m, and by anything where the axis is in the box
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
