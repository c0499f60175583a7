//! Contacts of polylines: where the end of one lies at another, or at a far part of its own.

use super::boxes::Bounds;
use super::polyline::arc_length;
use super::vector::{Point, squared_distance};
use crate::parallel::go_on;

/// An end of a polyline at a node of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contact {
    /// The end 2k is the first node of polyline k, 2k + 1 its last.
    pub end: usize,
    pub polyline: usize,
    /// The node that is nearest to the end, the first among equals.
    pub node: usize,
}

/// Returns the ends of polylines whose distance from a polyline's nearest node is less than `distance`, in order.
///
/// Nodes of an end's own polyline do not count if they are less than `apart` from it along the polyline.
pub(crate) fn find_contacts(polylines: &[&[Point]], distance: f64, apart: f64) -> Vec<Contact> {
    let lengths: Vec<Vec<f64>> = polylines.iter().map(|nodes| arc_length(nodes)).collect();
    let boxes: Vec<Bounds> = polylines.iter().map(|nodes| Bounds::about(nodes)).collect();
    let mut contacts = Vec::new();
    for (number, nodes) in polylines.iter().enumerate() {
        let ends = [0, nodes.len().wrapping_sub(1)];
        for (end, &tip) in ends.iter().enumerate().filter_map(|(end, &k)| Some((end, nodes.get(k)?))) {
            let place = lengths[number][ends[end]];
            let around = Bounds { low: tip.map(|x| x - distance), high: tip.map(|x| x + distance) };
            for (other, its) in polylines.iter().enumerate().filter(|&(other, _)| boxes[other].meets(&around))
            {
                go_on();
                let counts = |k: usize| other != number || (lengths[other][k] - place).abs() >= apart;
                let distances = its.iter().map(|&node| squared_distance(node, tip)).enumerate();
                let nearest = distances.filter(|&(k, _)| counts(k)).min_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((node, _)) = nearest.filter(|&(_, squared)| squared.sqrt() < distance) {
                    contacts.push(Contact { end: 2 * number + end, polyline: other, node });
                }
            }
        }
    }
    contacts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_end_touches_another_polyline_and_a_far_part_of_its_own() {
        let through: Vec<Point> = (0..9).map(|k| [f64::from(k), 0.0, 0.0]).collect();
        // it comes back to its own first node
        let hook = [[3.0, 0.5, 0.0], [3.0, 4.0, 0.0], [7.0, 4.0, 0.0], [3.0, 1.0, 0.0]];
        let found = find_contacts(&[&through, &hook], 0.75, 3.0);
        let contact = |end, polyline, node| Contact { end, polyline, node };
        assert_eq!(found, [contact(2, 0, 3), contact(2, 1, 3), contact(3, 1, 0)]);
        assert_eq!(find_contacts(&[&through, &hook], 0.75, 100.0), [contact(2, 0, 3)]);
        assert!(find_contacts(&[&through, &[]], 0.5, 3.0).is_empty());
    }

    proptest! {
        #[test]
        fn contacts_are_those_that_comparing_all_nodes_finds(
            polylines in prop::collection::vec(
                prop::collection::vec(prop::array::uniform3(0.0f64..2.0), 1..8), 1..5),
            distance in 0.1f64..2.0, apart in 0.0f64..3.0,
        ) {
            let polylines: Vec<&[Point]> = polylines.iter().map(Vec::as_slice).collect();
            let mut expected = Vec::new();
            for (number, nodes) in polylines.iter().enumerate() {
                let own = arc_length(nodes);
                for (late, at) in [0, nodes.len() - 1].into_iter().enumerate() {
                    for (other, its) in polylines.iter().enumerate() {
                        let mut best: Option<(f64, usize)> = None;
                        for (k, &node) in its.iter().enumerate() {
                            if other == number && (own[k] - own[at]).abs() < apart {
                                continue;
                            }
                            let away = squared_distance(node, nodes[at]).sqrt();
                            if away < distance && best.is_none_or(|(least, _)| away < least) {
                                best = Some((away, k));
                            }
                        }
                        let found = best.map(|(_, node)| Contact { end: 2 * number + late, polyline: other, node });
                        expected.extend(found);
                    }
                }
            }
            prop_assert_eq!(find_contacts(&polylines, distance, apart), expected);
        }
    }
}
