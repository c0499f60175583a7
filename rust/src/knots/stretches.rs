//! Stretches of a chain, closed as `closure` does it: which of them have a knot.
//!
//! From where its ends are led to, a closure is seen as the open chain with an arc above everything from its last to its
//! first node. So the crossings of the whole chain, once by direction, are also those of all stretches.

use super::alexander::mark;
use super::closure::directions;
use super::projection::Look;
use super::reidemeister::reduced;
use crate::geometry::Point;
use crate::parallel::go_on;

/// Between directions that are asked one after the other; no divisor in common with the number of directions.
const STRIDE: usize = 19;

/// A chain, and what was seen of it so far from the directions of closures.
pub struct Stretches<'a> {
    nodes: &'a [Point],
    directions: Vec<Point>,
    /// None from where it cannot be seen.
    looks: Vec<Option<Option<Look>>>,
}

impl<'a> Stretches<'a> {
    pub fn new(nodes: &'a [Point], closures: usize) -> Self {
        let directions: Vec<Point> = directions(closures).collect();
        Self { nodes, looks: directions.iter().map(|_| None).collect(), directions }
    }

    /// Whether more than half of the closures of the stretch between two nodes have an Alexander polynomial with this mark.
    /// As soon as those that have it are, or those that have not, so many more than the others, they count as most.
    pub fn most_have(&mut self, wanted: Option<u64>, from: usize, to: usize, lead: usize) -> bool {
        let count = self.directions.len();
        let (mut have, mut others) = (0, 0);
        while 2 * have <= count && 2 * others < count && have < others + lead && others < have + lead {
            go_on();
            // neighbours on the sphere are asked far apart
            let k = (have + others) * STRIDE % count;
            let look = self.looks[k].get_or_insert_with(|| Look::new(self.nodes, self.directions[k]).ok());
            let code = look.as_ref().and_then(|look| look.stretch(from, to));
            if code.is_some_and(|code| mark(&reduced(&code)) == wanted) {
                have += 1;
            } else {
                others += 1;
            }
        }
        have > others
    }
}
