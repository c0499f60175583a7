//! Overlaps of tubes.

use super::vector::{Point, squared_distance};
use crate::parallel::go_on;

/// A place on a curve.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Along {
    /// Number of the curve.
    pub curve: usize,
    /// Arc length along it, metres.
    pub arc_length: f64,
    pub position: Point,
}

/// Returns whether each place lies nearer than `distance` to another curve, or to a place of its own curve at least
/// `apart` along it.
pub(crate) fn find_overlaps(places: &[Along], distance: f64, apart: f64) -> Vec<bool> {
    let overlap = |a: &Along, b: &Along| {
        squared_distance(a.position, b.position) < distance * distance
            && (a.curve != b.curve || (a.arc_length - b.arc_length).abs() >= apart)
    };
    let any = |one: &Along| {
        go_on();
        places.iter().any(|other| overlap(one, other))
    };
    places.iter().map(any).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_overlap_others_and_themselves_farther_along() {
        let place = |curve, arc_length, x| Along { curve, arc_length, position: [x, 0.0, 0.0] };
        let places = [place(0, 0.0, 0.0), place(0, 1.0, 1.0), place(1, 0.0, 2.0)];
        assert_eq!(find_overlaps(&places, 1.5, 5.0), [false, true, true]);
        assert_eq!(find_overlaps(&places, 1.5, 1.0), [true, true, true]);
        assert_eq!(find_overlaps(&places, 0.5, 1.0), [false; 3]);
    }
}
