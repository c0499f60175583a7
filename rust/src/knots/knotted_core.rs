//! The knotted core: the shortest stretch of a chain that still is the same knot.

use super::alexander::mark;
use super::code::GaussCode;
use super::stretches::Stretches;
use super::thinning::thin;
use crate::geometry::Point;
use crate::geometry::polyline::arc_length;

/// In the search a stretch is taken for knotted, or for not, when so many more closures say so than do not.
const LEAD: usize = 2;
/// In the end it has to be clearer.
const CLEAR_LEAD: usize = 6;
/// How finely ends are sought, of the chain's length.
const STEP: f64 = 0.02;

/// The first and last node of the core of a chain that most of `closures` closures say is the knot of a diagram.
///
/// Nodes are taken off one end by bisection as long as most closures agree, then off the other, in both orders. The
/// shorter of the two stretches is the answer; it is made longer again until it is clear that most closures agree. Ends
/// are nodes up to a fiftieth of the length apart. Here knots are told by their Alexander polynomials alone.
pub fn knotted_core(nodes: &[Point], knot: &GaussCode, closures: usize) -> [usize; 2] {
    let arc = arc_length(nodes);
    let coarse = thin(nodes, false, STEP * arc[arc.len() - 1]);
    let places: Vec<usize> = coarse.after(coarse.triangles.len()).collect();
    let (last, left) = (places.len() - 1, coarse.left());
    let mut stretches = Stretches::new(&left, closures);
    let wanted = mark(knot);
    let mut is_knotted = |from: usize, to: usize, lead: usize| stretches.most_have(wanted, from, to, lead);
    let start = bisected(0, last, |taken| is_knotted(taken, last, LEAD));
    let stop = last - bisected(0, last, |taken| is_knotted(0, last - taken, LEAD));
    let both = if start < stop && is_knotted(start, stop, LEAD) {
        [[start, stop]; 2]
    } else {
        // what is short enough without the other end is no shorter with it
        let first = last - bisected(0, last - start.max(stop), |taken| is_knotted(start, last - taken, LEAD));
        let second = bisected(0, start.min(stop), |taken| is_knotted(taken, stop, LEAD));
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

/// The last number that holds, between one that does and one that does not.
fn bisected(mut holds: usize, mut fails: usize, mut is_so: impl FnMut(usize) -> bool) -> usize {
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
