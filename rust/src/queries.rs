//! Queries of planners against tubes: distances, rays and moving bodies.
//!
//! A tube is a union of capsules: everything within the chain's radius of the straight segments between its nodes. One
//! hierarchy of boxes, built once, holds the capsules of all chains. Each query is answered on its own, so answers are
//! equal bit for bit for any number of threads.

mod boxes;
mod capsule;
mod hierarchy;
mod least;
mod rays;

use rayon::prelude::*;

use crate::checks::{check_finite, check_positive, check_same_length};
use crate::error::{Error, Result};
use crate::geometry::{Point, RigidMotion, dot, normalized, squared_distance, sub};
use crate::parallel::{self, go_on};
use boxes::BoxMotion;
use capsule::Capsule;
pub use capsule::Place;
use hierarchy::Hierarchy;
use rays::Line;

const LOT: usize = 128; // queries that a thread answers in one go; fewer run on the thread of the caller

/// One chain's tube.
pub struct Path<'a> {
    /// At least two places in order, no two consecutive ones equal; a closed chain repeats its first place at the end.
    pub nodes: &'a [Point],
    /// Arc length at each node, metres.
    pub arc_length: &'a [f64],
    /// Radius, metres.
    pub radius: f64,
}

/// Where a ray meets a tube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub distance: f64,
    /// The place of the axis beside the hit.
    pub place: Place,
    /// Unit normal, out of the tube.
    pub normal: Point,
}

/// The contact and clearance of a moving body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sweep {
    /// The first time of contact, from 0 to 1; infinite if there is none.
    pub time: f64,
    /// The least distance of the body from a tube during the motion, metres; below 0 inside a tube.
    pub clearance: f64,
    /// The place of the axis at the first contact or, without contact, at the least distance.
    pub place: Place,
}

/// The tubes of several chains.
pub struct TubeQueries {
    hierarchy: Hierarchy,
}

impl TubeQueries {
    /// Sorts the segments of all chains.
    pub fn new(paths: &[Path<'_>]) -> Result<Self> {
        let mut capsules = Vec::new();
        for (chain, path) in paths.iter().enumerate() {
            check_finite("nodes", path.nodes)?;
            check_positive("radii", path.radius)?;
            check_same_length("arc_length", path.arc_length.len(), "nodes", path.nodes.len())?;
            for (ends, arc) in path.nodes.windows(2).zip(path.arc_length.windows(2)) {
                let capsule = Capsule::new([ends[0], ends[1]], [arc[0], arc[1]], path.radius, chain);
                capsules
                    .push(capsule.ok_or_else(|| Error::invalid("nodes", "expected no two equal in a row"))?);
            }
        }
        Ok(Self { hierarchy: Hierarchy::new(capsules) })
    }

    /// Returns for each point the least distance from a tube's surface, metres: negative inside, infinite without
    /// chains.
    pub fn signed_distances(&self, points: &[Point]) -> Result<Vec<f64>> {
        check_finite("points", points)?;
        Ok(answer_each(points.len(), |i| {
            self.hierarchy.nearest(points[i]).map_or(f64::INFINITY, |(value, _)| value)
        }))
    }

    /// Returns for each point the nearest place of the axis of the tube that it is nearest to, or deepest in, and the
    /// distance from the axis, metres.
    pub fn nearest(&self, points: &[Point]) -> Result<Vec<Option<(Place, f64)>>> {
        check_finite("points", points)?;
        Ok(answer_each(points.len(), |i| {
            let place = self.nearest_place(points[i])?;
            Some((place, squared_distance(points[i], place.point).sqrt()))
        }))
    }

    /// Returns where each ray first meets a tube: at its origin, if that is inside a tube.
    pub fn ray_hits(&self, origins: &[Point], directions: &[Point]) -> Result<Vec<Option<Hit>>> {
        check_finite("origins", origins)?;
        check_finite("directions", directions)?;
        check_same_length("directions", directions.len(), "origins", origins.len())?;
        if let Some(row) = directions.iter().position(|&d| d == [0.0; 3]) {
            let reason =
                format!("expected vectors that are not zero, but row {row} is {:?}", directions[row]);
            return Err(Error::invalid("directions", reason));
        }
        Ok(answer_each(origins.len(), |i| {
            let line = Line::ray(origins[i], directions[i]);
            let (distance, capsule) = self.hierarchy.first(&line, 0.0)?;
            let at = line.at(distance);
            let place = if distance > 0.0 { capsule.beside(at) } else { self.nearest_place(at)? };
            let out = sub(at, place.point);
            // on the axis, all ways out are equally near; below this, squares lose their digits
            let is_on_axis = dot(out, out) < f64::MIN_POSITIVE;
            let normal = if is_on_axis { line.direction().map(|x| -x) } else { normalized(out) };
            Some(Hit { distance, place, normal })
        }))
    }

    /// Sweeps spheres straight and evenly from a start to an end; exact up to rounding.
    pub fn swept_spheres(
        &self,
        starts: &[Point],
        ends: &[Point],
        radii: &[f64],
    ) -> Result<Vec<Option<Sweep>>> {
        check_finite("starts", starts)?;
        check_finite("ends", ends)?;
        check_same_length("ends", ends.len(), "starts", starts.len())?;
        check_same_length("radius", radii.len(), "starts", starts.len())?;
        radii.iter().try_for_each(|&radius| check_not_negative("radius", radius))?;
        Ok(answer_each(starts.len(), |i| {
            let radius = radii[i];
            let (least, approach, closest) = self.hierarchy.closest(starts[i], sub(ends[i], starts[i]))?;
            let clearance = least - radius;
            if clearance > 0.0 {
                return Some(Sweep { time: f64::INFINITY, clearance, place: closest.place(approach.along) });
            }
            let line = Line::between(starts[i], ends[i]);
            let (time, place) = match self.hierarchy.first(&line, radius) {
                Some((distance, capsule)) if distance > 0.0 => {
                    (line.share(distance), capsule.beside(line.at(distance)))
                }
                Some(_) => (0.0, self.nearest_place(starts[i])?),
                // a touch that rounding hides
                None => (approach.time, closest.place(approach.along)),
            };
            Some(Sweep { time, clearance, place })
        }))
    }

    /// Sweeps boxes from one pose to another, see [`BoxMotion`]. Contacts may be early, and clearances small, by at
    /// most its slack.
    pub fn swept_boxes(
        &self,
        starts: &[RigidMotion],
        ends: &[RigidMotion],
        half_sizes: &[Point],
    ) -> Result<Vec<Option<Sweep>>> {
        for (name, poses) in [("starts", starts), ("ends", ends)] {
            poses.iter().try_for_each(|pose| check_finite(name, &[pose.translation.into()]))?;
        }
        check_finite("half_sizes", half_sizes)?;
        check_same_length("ends", ends.len(), "starts", starts.len())?;
        check_same_length("half_sizes", half_sizes.len(), "starts", starts.len())?;
        half_sizes.as_flattened().iter().try_for_each(|&half| check_not_negative("half_sizes", half))?;
        Ok(answer_each(starts.len(), |i| {
            let motion = BoxMotion::new(&starts[i], &ends[i], half_sizes[i]);
            let (clearance, closest_at, closest) = self.hierarchy.clearance_of_box(&motion)?;
            let met =
                if clearance > motion.slack() { None } else { self.hierarchy.first_of_box(&motion, closest) };
            let (at, capsule) = met.unwrap_or((closest_at, closest));
            let place = capsule.place(motion.nearest(at, capsule).along);
            Some(Sweep { time: met.map_or(f64::INFINITY, |(time, _)| time), clearance, place })
        }))
    }

    fn nearest_place(&self, point: Point) -> Option<Place> {
        self.hierarchy.nearest(point).map(|(_, capsule)| capsule.beside(point))
    }
}

/// Answers queries in order, many of them in parallel.
fn answer_each<T: Send>(count: usize, answer: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    if count <= LOT {
        return (0..count).map(answer).collect();
    }
    let answer = |i: usize| {
        if i.is_multiple_of(LOT) {
            go_on();
        }
        answer(i)
    };
    parallel::run(|| (0..count).into_par_iter().with_min_len(LOT).map(answer).collect())
}

/// Refuses a negative or infinite length.
fn check_not_negative(name: &'static str, value: f64) -> Result<()> {
    if value == 0.0 {
        Ok(())
    } else {
        check_positive(name, value)
            .map_err(|_| Error::invalid(name, format!("expected finite numbers >= 0, got {value:?}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_beside_the_axis_have_unit_length() {
        let nodes = [[0.0; 3], [1.0, 0.0, 0.0]];
        let path = Path { nodes: &nodes, arc_length: &[0.0, 1.0], radius: 0.1 };
        let tubes = TubeQueries::new(&[path]).unwrap();
        for aside in [0.0, 5e-324, 1e-200, 1e-160, 1e-150, 1e-9] {
            let hits = tubes.ray_hits(&[[0.5, aside, 0.0]], &[[0.0, 0.0, 1.0]]).unwrap();
            let normal = hits[0].unwrap().normal;
            assert!((dot(normal, normal) - 1.0).abs() < 1e-12, "{normal:?}");
        }
    }

    #[test]
    fn poses_are_as_near_as_points() {
        let tubes = TubeQueries::new(&[]).unwrap();
        let far = RigidMotion { translation: [1e200, 0.0, 0.0].into(), ..RigidMotion::identity() };
        assert!(tubes.swept_boxes(&[far], &[RigidMotion::identity()], &[[0.1; 3]]).is_err());
        assert!(tubes.swept_boxes(&[RigidMotion::identity()], &[far], &[[0.1; 3]]).is_err());
    }
}
