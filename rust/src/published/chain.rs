//! Ordered chains from axis points by greedy tracing (section V-A, fig. 9–10 of *Shape Modeling of A String And
//! Recognition Using Distance Sensor*).

use crate::checks::{check_finite, check_positive};
use crate::error::{Error, Result};
use crate::geometry::{Point, centroid, squared_distance};
use crate::index::Grid;
use crate::index::hierarchy::remaining::Remaining;
use crate::parallel;

const BASES_PER_SORTED: usize = 8; // bases for each one that is sorted before the next chains

/// Traces chains of nodes through axis points, from both sides of a base point.
///
/// At first every point is a target. From the base point on, all points within `near` (r_n) of the current node stop
/// being targets, and the nearest target within `far` (r_f) becomes the next node. When none is left within `far`, the
/// other side of the base grows in the same way. The remaining targets form further chains. Each chain is a list of
/// indices from end to end; chains are in the order in which they were found.
///
/// The base of the first chain is `start`. Without it, and for later chains, the base is the target farthest from the
/// cloud's centroid. This rule depends neither on the frame nor on the order of the points.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, `near` is not positive, `far` is not
/// above `near`, or `start` is not the index of a point.
///
/// ```
/// let points: Vec<strand::Point> = (0..10).map(|i| [f64::from(i) * 0.01, 0.0, 0.0]).collect();
/// let chains = strand::trace_chains(&points, 0.015, 0.035, Some(0))?;
/// assert_eq!(chains, [[8, 6, 4, 2, 0]]);
/// # Ok::<(), strand::Error>(())
/// ```
pub fn trace_chains(points: &[Point], near: f64, far: f64, start: Option<usize>) -> Result<Vec<Vec<usize>>> {
    check_finite("points", points)?;
    check_positive("near", near)?;
    check_positive("far", far)?;
    if far <= near {
        return Err(Error::invalid("far", format!("expected more than near = {near}, got {far}")));
    }
    if let Some(start) = start.filter(|&start| start >= points.len()) {
        return Err(Error::invalid(
            "start",
            format!("expected an index below {}, got {start}", points.len()),
        ));
    }
    let grid = parallel::run(|| Grid::new(points, far));
    let center = centroid(points);
    let remoteness: Vec<f64> =
        (0..points.len()).map(|i| squared_distance(points[grid.input_index(i)], center)).collect();
    // positions in the grid's order, the farthest from the centroid first
    let farther = |&a: &usize, &b: &usize| {
        remoteness[b].total_cmp(&remoteness[a]).then(grid.input_index(a).cmp(&grid.input_index(b)))
    };
    let first = match start {
        Some(start) => (0..points.len()).find(|&position| grid.input_index(position) == start),
        None => (0..points.len()).min_by(farther),
    };
    let Some(first) = first else { return Ok(Vec::new()) };
    let remaining = grid.is_crowded().then(|| Remaining::new(grid.hierarchy()));
    let mut tracer = Tracer { grid: &grid, target: vec![true; points.len()], near, far, remaining };
    let mut chains = vec![tracer.chain(first)];
    let mut bases: Vec<usize> = (0..points.len()).collect();
    loop {
        bases.retain(|&position| tracer.target[position]);
        if bases.is_empty() {
            break;
        }
        // the chains of the farthest take most of the others, which then need no order
        let last = bases.len() / BASES_PER_SORTED;
        bases.select_nth_unstable_by(last, farther);
        bases[..=last].sort_unstable_by(farther);
        for &base in &bases[..=last] {
            if tracer.target[base] {
                chains.push(tracer.chain(base));
            }
        }
    }
    Ok(chains)
}

struct Tracer<'a> {
    grid: &'a Grid,
    target: Vec<bool>,
    near: f64,
    far: f64,
    /// The targets, where a node may have very many around it.
    remaining: Option<Remaining<'a>>,
}

impl Tracer<'_> {
    /// Returns the indices of the nodes that grow from both sides of a base.
    fn chain(&mut self, base: usize) -> Vec<usize> {
        let mut chain = self.grow(base);
        chain.reverse();
        chain.pop();
        let other_side = self.grow(base);
        chain.extend(&other_side);
        chain.into_iter().map(|position| self.grid.input_index(position)).collect()
    }

    /// Returns the nodes from `base` on, until no target is within reach.
    fn grow(&mut self, base: usize) -> Vec<usize> {
        let mut nodes = vec![base];
        let mut current = Some(base);
        while let Some(node) = current {
            current = self.next(node);
            nodes.extend(current);
        }
        nodes
    }

    /// Clears the targets within `near` of a node and returns the nearest other target within reach.
    fn next(&mut self, node: usize) -> Option<usize> {
        parallel::go_on();
        let Self { grid, target, near, far, remaining } = self;
        let mut nearest: Option<(f64, usize)> = None;
        let limit = *near * *near;
        if let Some(remaining) = remaining {
            remaining.take(grid.point(node), limit, |other| target[other] = false);
            return remaining.nearest(grid.point(node), *far * *far);
        }
        grid.visit_around(node, |other, _, squared| {
            if squared <= limit {
                target[other] = false;
            } else if target[other] && nearest.is_none_or(|(least, _)| squared < least) {
                nearest = Some((squared, other));
            }
        });
        nearest.map(|(_, other)| other)
    }
}
