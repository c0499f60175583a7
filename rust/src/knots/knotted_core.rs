//! The knotted core: the shortest stretch of a chain that still has its knot.

use super::alexander::compute_mark;
use super::code::GaussCode;
use super::stretches::Stretches;
use super::thinning::thin;
use crate::geometry::Point;
use crate::geometry::polyline::arc_length;

const LEAD: usize = 2; // lead in closures that decides during the search whether a stretch is knotted
const CLEAR_LEAD: usize = 6; // lead in closures that decides about the final stretch
const STEP: f64 = 0.02; // resolution of the core's ends, lengths of the chain

/// Finds the first and last node of the core of a chain: most of `closures` closures give the knot of a diagram.
///
/// Bisection removes nodes from one end while most closures agree, then from the other, in both orders. The shorter
/// stretch is extended until a clear majority agrees. The ends are nodes up to a fiftieth of the length apart. Only
/// Alexander polynomials distinguish knots here.
pub fn find_knotted_core(nodes: &[Point], knot: &GaussCode, closures: usize) -> [usize; 2] {
    let arc = arc_length(nodes);
    let coarse = thin(nodes, false, STEP * arc[arc.len() - 1]);
    let places: Vec<usize> = coarse.after(coarse.triangles.len()).collect();
    let (last, left) = (places.len() - 1, coarse.left());
    let mut stretches = Stretches::new(&left, closures);
    let wanted = compute_mark(knot);
    let mut is_knotted = |from: usize, to: usize, lead: usize| stretches.most_have(wanted, from, to, lead);
    let start = bisect(0, last, |taken| is_knotted(taken, last, LEAD));
    let stop = last - bisect(0, last, |taken| is_knotted(0, last - taken, LEAD));
    let both = if start < stop && is_knotted(start, stop, LEAD) {
        [[start, stop]; 2]
    } else {
        // a stretch that cannot be shortened without the other end cannot be shortened with it
        let first = last - bisect(0, last - start.max(stop), |taken| is_knotted(start, last - taken, LEAD));
        let second = bisect(0, start.min(stop), |taken| is_knotted(taken, stop, LEAD));
        [[start, first], [second, stop]]
    };
    let length = |ends: [usize; 2]| arc[places[ends[1]]] - arc[places[ends[0]]];
    let [mut from, mut to] = if length(both[0]) <= length(both[1]) { both[0] } else { both[1] };
    let mut step = 1;
    while (from, to) != (0, last) && !is_knotted(from, to, CLEAR_LEAD) {
        (from, to) = (from.saturating_sub(step), last.min(to + step));
        step *= 2;
    }
    [places[from], places[to]]
}

/// Returns the last number that holds, between one that does and one that does not.
fn bisect(mut holds: usize, mut fails: usize, mut is_so: impl FnMut(usize) -> bool) -> usize {
    while fails - holds > 1 {
        let middle = holds.midpoint(fails);
        if is_so(middle) {
            holds = middle;
        } else {
            fails = middle;
        }
    }
    holds
}
