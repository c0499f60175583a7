//! Stretches of a chain, closed as in `closure`: which of them are knotted.
//!
//! Seen from where its ends are led to, a closure is the open chain with an arc above everything, from the last node to
//! the first. So the crossings of the whole chain, found once for each direction, serve all stretches.

use super::alexander::compute_mark;
use super::closure::spread_directions;
use super::projection::Look;
use super::reidemeister::reduced;
use crate::geometry::Point;
use crate::parallel::go_on;

const STRIDE: usize = 19; // step from one direction to the next; coprime to the number of directions

/// A chain, and its views from the directions of closures so far.
pub struct Stretches<'a> {
    nodes: &'a [Point],
    directions: Vec<Point>,
    /// The inner None stands for a direction from which the chain cannot be seen.
    looks: Vec<Option<Option<Look>>>,
}

impl<'a> Stretches<'a> {
    pub fn new(nodes: &'a [Point], closures: usize) -> Self {
        let directions: Vec<Point> = spread_directions(closures).collect();
        Self { nodes, looks: directions.iter().map(|_| None).collect(), directions }
    }

    /// Returns whether more than half of the closures of the stretch between two nodes have an Alexander polynomial
    /// with this mark. A lead of `lead` closures decides early.
    pub fn most_have(&mut self, wanted: Option<u64>, from: usize, to: usize, lead: usize) -> bool {
        let count = self.directions.len();
        let (mut have, mut others) = (0, 0);
        while 2 * have <= count && 2 * others < count && have < others + lead && others < have + lead {
            go_on();
            // consecutive directions are far apart on the sphere
            let k = (have + others) * STRIDE % count;
            let look = self.looks[k].get_or_insert_with(|| Look::new(self.nodes, self.directions[k]).ok());
            let code = look.as_ref().and_then(|look| look.stretch(from, to));
            if code.is_some_and(|code| compute_mark(&reduced(&code)) == wanted) {
                have += 1;
            } else {
                others += 1;
            }
        }
        have > others
    }
}
