//! Arcs of tubes traced through oriented points.
//!
//! Where strands touch, an average over a neighbourhood mixes them. A tube fitted to the points that face their
//! cameras, with no points inside it, keeps them separate: two touching strands lie outside each other.

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::checks::{check_finite, check_positive, check_same_length};
use crate::error::Result;
use crate::geometry::{
    Moments, Point, advance, cell_of, dot, eigen_symmetric, normalized, squared_distance, sub,
};
use crate::index::Grid;
use crate::normals::Viewpoints;
use crate::parallel;
use crate::tubes::tubelet::{Freedom, Patch, Support, Tubelet, fit, make_frame};

const PATCH: f64 = 2.6; // largest distance of points from a tubelet's centre that matter to it, radii
const MIN_SCORE: f64 = 0.25; // score of a seed at least, as a share of the seeds' 90th percentile
const CLEARANCE: f64 = 0.7; // seeds nearer than this to a node are dropped, radii
const COLLISION: f64 = 0.6; // an arc ends nearer than this to another arc, or to its own earlier nodes, radii
/// Side of the cubes in which nodes are looked up, radii: much longer than these two, so most look-ups meet one or two
/// cubes.
const CUBE: f64 = 6.0;
/// Default of the fewest nodes of an arc.
pub const MIN_NODES: usize = 4;
const CLAIMED: [f64; 2] = [0.6, 1.45]; // points nearer to a node, along the arc and across it, are the arc's, radii
const STEP: f64 = 0.5; // distance between the nodes of an arc, radii
/// Sides of the voxels that give one seed each, radii; a smaller side follows where arcs left points free.
const SEED_VOXELS: [f64; 3] = [4.8, 2.4, 0.8];
const AROUND: f64 = 1.3; // points nearer than this to a seed give its normal, radii
const DIRECTIONS: usize = 6; // directions that are tried at a seed
/// Seeds that one task fits; fixed, so that results do not depend on the number of threads.
const SEEDS_PER_TASK: usize = 4;

/// First fit of a seed: any direction, no bend.
const FIRST_LOOK: Freedom = Freedom { half_length: 1.5, band: 0.8, steps: 3, prior: [1.0, 1.0, 0.0] };
/// Second fit of a seed.
const SECOND_LOOK: Freedom = Freedom { half_length: 1.5, band: 0.5, steps: 6, prior: [1.0, 1.0, 0.0] };
/// Fit of a step along an arc.
const MARCH: Freedom = Freedom { half_length: 1.6, band: 0.5, steps: 6, prior: [0.25, 0.25, 0.12] };

/// A stretch of rope whose surface the cameras saw.
#[derive(Debug, Clone, PartialEq)]
pub struct Arc {
    /// Nodes of the axis, half a radius apart, metres.
    pub nodes: Vec<Point>,
    /// Points that support each node: on the surface, facing their camera, within a radius ahead of the node.
    pub support: Vec<f64>,
}

/// Traces arcs of tubes of a known radius through surface points.
///
/// 1. It fits tubelets in several directions at seeds 4.8 r apart.
/// 2. From the best free tubelet, it follows the axis both ways in steps of r / 2. Each step is a fit with a prior
///    around the last one. An arc ends where no points lie ahead, the axis jumps or turns by more than 0.5 rad, points
///    lie inside the tube, or another arc is near.
/// 3. The arc claims its points, and the next best seed follows.
/// 4. The same is done with seeds 2.4 r and 0.8 r apart among the remaining points.
///
/// Arcs of fewer than `min_nodes` nodes are dropped.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite, there is not one viewpoint for
/// each point, or `radius` is not positive.
pub fn trace_tubes(
    points: &[Point],
    viewpoints: Viewpoints,
    radius: f64,
    min_nodes: usize,
) -> Result<Vec<Arc>> {
    check_finite("points", points)?;
    check_positive("radius", radius)?;
    if let Viewpoints::Each(all) = viewpoints {
        check_same_length("viewpoint", all.len(), "points", points.len())?;
        check_finite("viewpoint", all)?;
    } else if let Viewpoints::One(one) = viewpoints {
        check_finite("viewpoint", &[one])?;
    }
    let to_camera: Vec<Point> = (0..points.len())
        .map(|i| match viewpoints {
            Viewpoints::One(c) => normalized(sub(c, points[i])),
            Viewpoints::Each(all) => normalized(sub(all[i], points[i])),
        })
        .collect();
    Ok(parallel::run(|| {
        let grid = Grid::new(points, PATCH * radius);
        let to_camera = grid.gather(&to_camera);
        let mut tracer = Tracer {
            grid,
            to_camera,
            free: vec![true; points.len()],
            radius,
            nodes: Nodes::new(CUBE * radius),
        };
        tracer.trace(min_nodes)
    }))
}

struct Tracer {
    grid: Grid,
    /// Directions to the cameras, and whether points are unclaimed, in the grid's order.
    to_camera: Vec<Point>,
    free: Vec<bool>,
    radius: f64,
    /// The nodes of all arcs so far.
    nodes: Nodes,
}

/// Nodes, looked up by cubes of space.
struct Nodes {
    side: f64,
    cubes: FxHashMap<[i64; 3], Vec<Point>>,
}

impl Nodes {
    /// Starts without nodes.
    fn new(side: f64) -> Self {
        Self { side, cubes: FxHashMap::default() }
    }

    fn extend(&mut self, nodes: &[Point]) {
        for &node in nodes {
            self.cubes.entry(cell_of(node, self.side)).or_default().push(node);
        }
    }

    /// Returns whether a node is nearer to a place than a distance, given its square.
    fn any_within(&self, place: Point, limit: f64) -> bool {
        // rounding moves a cube's border by less than this
        let reach = limit.sqrt() * (1.0 + 1e-9) + 1e-12 * self.side;
        let low = cell_of(place.map(|x| x - reach), self.side);
        let high = cell_of(place.map(|x| x + reach), self.side);
        let cubes = (low[0]..=high[0])
            .flat_map(|x| (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z])));
        cubes
            .filter_map(|cube| self.cubes.get(&cube))
            .flatten()
            .any(|&node| squared_distance(node, place) < limit)
    }
}

struct Seed {
    tubelet: Tubelet,
    support: Support,
}

impl Tracer {
    fn trace(&mut self, min_nodes: usize) -> Vec<Arc> {
        let mut arcs = Vec::new();
        let mut enough = None;
        for size in SEED_VOXELS {
            let mut seeds = self.seeds(size);
            seeds.sort_by(|a, b| b.support.score.total_cmp(&a.support.score));
            let Some(good) = seeds.get(seeds.len() / 10) else { continue };
            let enough = *enough.get_or_insert(MIN_SCORE * good.support.score);
            self.follow(seeds, enough, min_nodes, &mut arcs);
        }
        arcs
    }

    /// Traces arcs from seeds of at least a score, the best first.
    fn follow(&mut self, seeds: Vec<Seed>, enough: f64, min_nodes: usize, arcs: &mut Vec<Arc>) {
        for seed in seeds {
            parallel::go_on();
            if seed.support.score < enough {
                break;
            }
            if self.taken(seed.tubelet.center) {
                continue;
            }
            // the free points that remain may no longer form a tube
            let (tubelet, support) = fit(&self.patch(seed.tubelet.center), seed.tubelet, &SECOND_LOOK);
            let moved = squared_distance(tubelet.center, seed.tubelet.center).sqrt();
            if support.score < (0.6 * seed.support.score).max(enough)
                || moved > 0.5 * self.radius
                || self.taken(tubelet.center)
            {
                continue;
            }
            let density = support.inliers as f64 / 3.0;
            let (ahead, mut back) =
                rayon::join(|| self.march(tubelet, density), || self.march(tubelet.reversed(), density));
            // on a ring, each way leads all the way round
            let limit = (COLLISION * self.radius).powi(2);
            let passed =
                |node: Point| ahead.iter().skip(3).any(|step| squared_distance(step.0.center, node) < limit);
            if let Some(met) = back.iter().position(|step| passed(step.0.center)) {
                back.truncate(met);
            }
            let mut steps: Vec<(Tubelet, f64)> = back.into_iter().rev().collect();
            steps.push((tubelet, density));
            steps.extend(ahead);
            if steps.len() >= min_nodes {
                self.claim(&steps);
                let (nodes, support): (Vec<Point>, Vec<f64>) =
                    steps.iter().map(|(tubelet, support)| (tubelet.center, *support)).unzip();
                self.nodes.extend(&nodes);
                arcs.push(Arc { nodes, support });
            }
        }
    }

    /// Collects the free points near a place, in the grid's order.
    fn patch(&self, center: Point) -> Patch {
        let mut patch = Patch::new(center, self.radius);
        self.grid.visit_near(center, PATCH * self.radius, |i, p, _| {
            if self.free[i] {
                patch.push(p, self.to_camera[i]);
            }
        });
        patch
    }

    fn taken(&self, center: Point) -> bool {
        self.nodes.any_within(center, (CLEARANCE * self.radius).powi(2))
    }

    /// Fits tubelets at one free point of each voxel; `size` is the voxel's side in radii. Keeps the best of several
    /// directions.
    fn seeds(&self, size: f64) -> Vec<Seed> {
        let chosen = self.grid.sample(size * self.radius, |i| self.free[i]);
        let fitted: Vec<Vec<Option<Seed>>> = chosen
            .par_chunks(SEEDS_PER_TASK)
            .map(|positions| positions.iter().map(|&i| self.seed(i)).collect())
            .collect();
        fitted.into_iter().flatten().flatten().filter(|seed| seed.support.inliers >= 8).collect()
    }

    fn seed(&self, position: usize) -> Option<Seed> {
        parallel::go_on();
        let p = self.grid.point(position);
        let mut moments = Moments::default();
        self.grid.visit_near(p, AROUND * self.radius, |_, q, _| moments.add(sub(q, p)));
        if moments.count() < 6 {
            return None;
        }
        let mut normal = eigen_symmetric(&moments.covariance()).vectors[0];
        if dot(normal, self.to_camera[position]) < 0.0 {
            normal = normal.map(|x| -x);
        }
        let center = advance(p, -self.radius, normal);
        if self.taken(center) {
            return None;
        }
        let patch = self.patch(center);
        let (f1, f2) = make_frame(normal);
        let rough = (0..DIRECTIONS).map(|k| {
            let (sin, cos) = (std::f64::consts::PI * k as f64 / DIRECTIONS as f64).sin_cos();
            let tangent = std::array::from_fn(|i| cos * f1[i] + sin * f2[i]);
            fit(&patch, Tubelet { center, tangent, curvature: [0.0; 3] }, &FIRST_LOOK)
        });
        let (tubelet, _) = rough.max_by(|a, b| a.1.score.total_cmp(&b.1.score))?;
        let (tubelet, support) = fit(&self.patch(tubelet.center), tubelet, &SECOND_LOOK);
        Some(Seed { tubelet, support })
    }

    /// Follows the axis one way.
    fn march(&self, start: Tubelet, density: f64) -> Vec<(Tubelet, f64)> {
        let r = self.radius;
        let mut steps: Vec<(Tubelet, f64)> = Vec::new();
        let (mut last, mut typical) = (start, density);
        loop {
            parallel::go_on();
            let expected = last.ahead(STEP * r);
            let patch = self.patch(expected.center);
            let (tubelet, support) = fit(&patch, expected, &MARCH);
            let ahead = patch.support_ahead(&tubelet);
            let straight = dot(tubelet.tangent, last.tangent) > 0.5f64.cos();
            let jump = squared_distance(tubelet.center, expected.center).sqrt();
            let limit = (COLLISION * r).powi(2);
            let collides = |node: &Point| squared_distance(*node, tubelet.center) < limit;
            let own = steps.len().saturating_sub(8);
            if ahead < (0.22 * typical).max(3.0)
                || !straight
                || jump >= 0.6 * r
                || support.inside as f64 >= 0.5 * support.inliers as f64 + 2.0
                || self.nodes.any_within(tubelet.center, limit)
                || steps[..own].iter().any(|step| collides(&step.0.center))
            {
                return steps;
            }
            typical = 0.8 * typical + 0.2 * ahead;
            steps.push((tubelet, ahead));
            last = tubelet;
            let bend = dot(last.curvature, last.curvature).sqrt();
            if bend > 0.5 / r {
                last.curvature = last.curvature.map(|x| x * 0.5 / r / bend);
            }
        }
    }

    /// Claims the points of an arc.
    fn claim(&mut self, steps: &[(Tubelet, f64)]) {
        let r = self.radius;
        for (tubelet, _) in steps {
            let Self { grid, to_camera, free, .. } = self;
            grid.visit_near(tubelet.center, CLAIMED[0].hypot(CLAIMED[1]) * r * (1.0 + 1e-9), |i, p, _| {
                let x = sub(p, tubelet.center);
                let along = dot(x, tubelet.tangent);
                // most points are beside the step, or claimed by the last one
                if !free[i] || along.abs() > CLAIMED[0] * r {
                    return;
                }
                let outward = advance(x, -along, tubelet.tangent);
                let distance = dot(outward, outward).sqrt();
                if distance < CLAIMED[1] * r
                    && (distance < 0.5 * r || dot(outward, to_camera[i]) > -0.2 * distance)
                {
                    free[i] = false;
                }
            });
        }
    }
}
