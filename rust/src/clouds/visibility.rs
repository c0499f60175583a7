//! Space as the cameras saw it: occupied, occluded or free.

mod rays;

use std::collections::HashSet;

use rayon::prelude::*;

use crate::checks::{check_finite, check_positive};
use crate::error::Result;
use crate::geometry::{Point, RigidMotion, advance, cross, dot, normalized, sub};
use crate::parallel;
pub(crate) use rays::Observed;
use rays::{Cells, MAX_TANGENT, Rays, Window, lower_to_rays, mark_taken};

const CELL: f64 = 1.6; // width of a cell of a view's grid of directions, spacings between neighbouring points
const MARGIN: f64 = 0.1; // margin of the grid around the directions that callers ask about, tangents
const CLEARANCE: f64 = 1.0; // depth by which an obstacle must be in front of or behind a place, radii
const MIN_POINTS: usize = 16; // points of a view at least; a view with fewer knows nothing
const MAX_CELLS: f64 = 4e7; // cells of a view at most; a view of more widely scattered points knows nothing

/// The state of a tube at a place, as one view shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Occupancy {
    /// The view has no points in that direction.
    Unknown,
    /// All points in that direction lie in front of the tube.
    Occluded,
    /// Points lie where the tube's surface would be.
    Occupied,
    /// All points in that direction lie behind the tube.
    Free,
}

/// One view, for [`Visibility::new`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct VisibilityView<'a> {
    /// All its data, background included: a ray that reached the table passed through free space.
    pub observed: Observed<'a>,
    /// Points near all places that callers will ask about; directions far from all of them are dropped.
    pub about: &'a [Point],
    /// Camera to world.
    pub pose: RigidMotion,
}

/// Free and occupied space as all views saw it.
#[derive(Debug)]
pub(crate) struct Visibility {
    views: Vec<(Point, Option<Buffer>)>,
}

/// The least distance of a view's points in each direction from its camera.
///
/// Directions are gridded on the plane at distance 1 in front of the camera, perpendicular to the third axis.
#[derive(Debug)]
struct Buffer {
    /// World frame.
    axes: [Point; 3],
    cell: f64,
    low: [f64; 2],
    shape: [usize; 2],
    nearest: Vec<f32>,
}

impl Visibility {
    /// Grids views by direction.
    pub fn new(views: &[VisibilityView]) -> Result<Self> {
        for view in views {
            check_finite("about", view.about)?;
        }
        let of_view = |view: &VisibilityView| (view.pose.translation.into(), Buffer::new(view));
        Ok(Self { views: parallel::run(|| views.par_iter().map(of_view).collect()) })
    }

    pub fn views(&self) -> usize {
        self.views.len()
    }

    /// Returns what one view shows of tubes of a radius around places of the world.
    pub fn states(&self, view: usize, places: &[Point], radius: f64) -> Result<Vec<Occupancy>> {
        check_positive("radius", radius)?;
        let (camera, buffer) = &self.views[view];
        let state = |&place: &Point| match buffer {
            Some(buffer) => buffer.state(sub(place, *camera), radius),
            None => Occupancy::Unknown,
        };
        Ok(places.iter().map(state).collect())
    }

    /// Returns whether the space at places is free: more views saw it free than occupied.
    pub fn free(&self, places: &[Point], radius: f64) -> Result<Vec<bool>> {
        let mut votes = vec![0i64; places.len()];
        for view in 0..self.views() {
            for (vote, state) in votes.iter_mut().zip(self.states(view, places, radius)?) {
                *vote += i64::from(state == Occupancy::Free) - i64::from(state == Occupancy::Occupied);
            }
        }
        Ok(votes.into_iter().map(|vote| vote > 0).collect())
    }

    /// Returns whether places are occluded in all views or outside their images.
    pub fn occluded(&self, places: &[Point], radius: f64) -> Result<Vec<bool>> {
        let mut occluded = vec![true; places.len()];
        for view in 0..self.views() {
            for (occluded, state) in occluded.iter_mut().zip(self.states(view, places, radius)?) {
                *occluded &= matches!(state, Occupancy::Occluded | Occupancy::Unknown);
            }
        }
        Ok(occluded)
    }

    /// Returns whether a view saw through the near side of a tube along the unit vector `direction`, around places.
    pub fn seen_through(&self, places: &[Point], direction: Point, radius: f64) -> Result<Vec<bool>> {
        check_positive("radius", radius)?;
        let through = |&place: &Point| {
            self.views.iter().any(|(camera, buffer)| {
                let Some(buffer) = buffer else { return false };
                let to_camera = sub(*camera, place);
                let across = normalized(advance(to_camera, -dot(to_camera, direction), direction));
                let surface = sub(advance(place, radius, across), *camera);
                // the axis of the tube whose near side is there
                let within = advance(surface, radius, normalized(surface));
                buffer.state(within, radius) == Occupancy::Free
            })
        };
        Ok(places.iter().map(through).collect())
    }
}

/// Returns whether any of `others` occludes a stretch from a camera. It does if it lies within `distance` of a line of
/// sight, in front of the stretch or beside it.
pub(crate) fn occludes(others: &[Point], stretch: &[Point], camera: Point, distance: f64) -> bool {
    stretch.iter().any(|&place| {
        parallel::go_on();
        let to_camera = normalized(sub(camera, place));
        others.iter().any(|&other| {
            let offset = sub(other, place);
            let depth = dot(offset, to_camera);
            depth > -distance && dot(offset, offset) - depth * depth < distance * distance
        })
    })
}

impl Buffer {
    /// Grids one view; None if it has too few points.
    fn new(view: &VisibilityView) -> Option<Self> {
        let axes = axes_towards(view.about)?;
        let asked = bounds_of(view.about.iter().filter_map(|&p| find_direction(p, &axes)))?;
        let [low, high] = [asked[0].map(|x| (x - MARGIN) as f32), asked[1].map(|x| (x + MARGIN) as f32)];
        let rays = view.observed.rays(&Window { axes, low, high });
        let count = rays.iter().map(Rays::count).sum();
        if count < MIN_POINTS {
            return None;
        }
        let [low, high] = bounds_of(rays.iter().filter_map(Rays::bounds).flatten())?;
        let cell = CELL * spacing(&rays, count, low, high);
        let cells = Cells::new(low, cell);
        let last = cells.of(high.map(|x| x as f32));
        if (last[0] + 1) as f64 * (last[1] + 1) as f64 > MAX_CELLS {
            return None;
        }
        let shape = last.map(|x| x + 1);
        let mut nearest = vec![f32::INFINITY; shape[0] * shape[1]];
        rays.iter().for_each(|rays| lower_to_rays(rays, cells, shape[1], &mut nearest));
        for distance in &mut nearest {
            *distance = distance.sqrt();
        }
        let turned = axes.map(|axis| (view.pose.rotation * nalgebra::Vector3::from(axis)).into());
        Some(Self { axes: turned, cell, low, shape, nearest })
    }

    /// Returns the state of a place, given relative to the view's camera.
    fn state(&self, offset: Point, radius: f64) -> Occupancy {
        let reach = dot(offset, offset).sqrt() - radius;
        let [x, y, depth] = self.axes.map(|axis| dot(axis, offset));
        if depth <= reach.max(1e-12) / 1f64.hypot(MAX_TANGENT) {
            return Occupancy::Unknown;
        }
        let place = [0, 1].map(|k| (([x, y][k] / depth - self.low[k]) / self.cell).floor());
        if (0..2).any(|k| place[k] < 0.0 || place[k] >= self.shape[k] as f64) {
            return Occupancy::Unknown;
        }
        let nearest = f64::from(self.nearest[place[0] as usize * self.shape[1] + place[1] as usize]);
        if nearest == f64::INFINITY {
            Occupancy::Unknown
        } else if nearest < reach - CLEARANCE * radius {
            Occupancy::Occluded
        } else if nearest > reach + CLEARANCE * radius {
            Occupancy::Free
        } else {
            Occupancy::Occupied
        }
    }
}

/// Returns orthogonal unit vectors, the third towards the middle of points; None for too few points or points all
/// around.
fn axes_towards(about: &[Point]) -> Option<[Point; 3]> {
    let ways: Vec<Point> = about.iter().filter(|&&p| p != [0.0; 3]).map(|&p| normalized(p)).collect();
    if ways.len() < MIN_POINTS {
        return None;
    }
    let middle = crate::geometry::centroid(&ways);
    if dot(middle, middle).sqrt() < 0.1 {
        return None;
    }
    let forward = normalized(middle);
    let least = (0..3).fold(0, |least, k| if forward[k].abs() < forward[least].abs() { k } else { least });
    let side = normalized(cross(forward, std::array::from_fn(|k| f64::from(u8::from(k == least)))));
    Some([side, cross(forward, side), forward])
}

/// Returns the direction to a point; None if the point is behind the camera or far to the side.
fn find_direction(point: Point, axes: &[Point; 3]) -> Option<[f64; 2]> {
    let depth = dot(point, axes[2]);
    let flat = [dot(point, axes[0]) / depth, dot(point, axes[1]) / depth];
    let near = depth > 0.0 && flat.iter().all(|x| x.abs() < MAX_TANGENT);
    near.then(|| flat.map(|x| f64::from(x as f32)))
}

/// Returns the corners of the box around directions; None without directions.
fn bounds_of(directions: impl Iterator<Item = [f64; 2]>) -> Option<[[f64; 2]; 2]> {
    let start = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    let [low, high] = directions.fold(start, |[low, high], flat| {
        [[0, 1].map(|k| low[k].min(flat[k])), [0, 1].map(|k| high[k].max(flat[k]))]
    });
    (low[0] <= high[0]).then_some([low, high])
}

/// Estimates the spacing of directions: the side of the area that each has to itself.
fn spacing(rays: &[Rays], count: usize, low: [f64; 2], high: [f64; 2]) -> f64 {
    let extent: [f64; 2] = std::array::from_fn(|k| high[k] - low[k]);
    let longest = extent[0].max(extent[1]);
    let mut area = (extent[0] * extent[1]).max(1e-4 * longest * longest).max(1e-18);
    // refine from the area of the box to that of the cells with points, each a few points wide
    for _ in 0..2 {
        let cell = 3.0 * (area / count as f64).sqrt();
        let cells = Cells::new(low, cell);
        let last = cells.of(high.map(|x| x as f32));
        let taken = if (last[0] as f64 + 1.0) * (last[1] as f64 + 1.0) > MAX_CELLS {
            let taken: HashSet<[usize; 2]> =
                rays.iter().flat_map(Rays::directions).map(|flat| cells.of(flat)).collect();
            taken.len()
        } else {
            let mut taken = vec![false; (last[0] + 1) * (last[1] + 1)];
            rays.iter().for_each(|rays| mark_taken(rays, cells, last[1] + 1, &mut taken));
            taken.into_iter().filter(|&taken| taken).count()
        };
        area = taken as f64 * cell * cell;
    }
    (area / count as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clouds::depth::Pinhole;

    /// A wall at z = 1 with a tube's width of nearer points in the middle, seen from the origin.
    fn wall_and_bar() -> Vec<Point> {
        let mut points = Vec::new();
        for i in -100..=100 {
            for j in -100..=100 {
                let (x, y) = (f64::from(i) * 0.003, f64::from(j) * 0.003);
                let z = if x.abs() < 0.02 { 0.5 } else { 1.0 };
                points.push([x * z, y * z, z]);
            }
        }
        points
    }

    #[test]
    fn places_are_occupied_occluded_free_or_unknown() {
        let points = wall_and_bar();
        let pose = RigidMotion::identity();
        let visibility =
            Visibility::new(&[VisibilityView { observed: Observed::Points(&points), about: &points, pose }])
                .unwrap();
        let places = [[0.0, 0.1, 0.51], [0.0, 0.1, 0.8], [0.1, 0.1, 0.5], [0.0, 0.0, -1.0], [0.9, 0.0, 1.0]];
        let states = visibility.states(0, &places, 0.01).unwrap();
        let around = visibility.seen_through(&places, [0.0, 1.0, 0.0], 0.01).unwrap();
        assert_eq!(around, [false, false, true, false, false]);
        assert_eq!(
            states,
            [
                Occupancy::Occupied,
                Occupancy::Occluded,
                Occupancy::Free,
                Occupancy::Unknown,
                Occupancy::Unknown
            ]
        );
        assert_eq!(visibility.free(&places, 0.01).unwrap(), [false, false, true, false, false]);
        assert_eq!(visibility.occluded(&places, 0.01).unwrap(), [false, true, false, true, true]);
    }

    #[test]
    fn a_depth_image_says_what_its_points_say() {
        let camera = Pinhole { focal: [90.0, 80.0], center: [99.0, 101.0] };
        let depth: Vec<f64> = (0..200 * 210)
            .map(|i| match (i % 200, i / 200) {
                (u, _) if u % 17 == 3 => f64::NAN,
                (u, v) if u + v < 150 => 0.5,
                _ => 1.0,
            })
            .collect();
        let points = crate::clouds::depth::unproject(&depth, 200, camera);
        let pose = RigidMotion { translation: [0.1, 0.0, -0.2].into(), ..RigidMotion::identity() };
        let views = [Observed::Image(&depth, 200, camera), Observed::Points(&points)]
            .map(|observed| VisibilityView { observed, about: &points, pose });
        let visibility = Visibility::new(&views).unwrap();
        let places: Vec<Point> = points.iter().step_by(7).map(|p| [p[0] + 0.1, p[1], 0.6]).collect();
        let states = visibility.states(0, &places, 0.01).unwrap();
        assert_eq!(states, visibility.states(1, &places, 0.01).unwrap());
        for kind in [Occupancy::Occluded, Occupancy::Free] {
            assert!(states.contains(&kind));
        }
    }

    #[test]
    fn a_view_of_hardly_any_points_knows_nothing() {
        let points = [[0.0, 0.0, 1.0]; 3];
        let view = VisibilityView {
            observed: Observed::Points(&points),
            about: &points,
            pose: RigidMotion::identity(),
        };
        let visibility = Visibility::new(&[view]).unwrap();
        assert_eq!(visibility.states(0, &points, 0.1).unwrap(), [Occupancy::Unknown; 3]);
        assert!(visibility.states(0, &points, 0.0).is_err());
    }
}
