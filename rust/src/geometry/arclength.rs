//! Arc length along a spline, from a table.

use super::spline::{Place, Spline};
use super::vector::{Point, cut_off, dot, normalized};

const ENTRIES_PER_SPAN: f64 = 16.0; // table entries for each span; arc length is linear in the parameter between them

/// A part of a spline that is parameterized by arc length.
pub(crate) struct ByLength<'a> {
    spline: &'a Spline,
    /// The parameters of its ends.
    range: [f64; 2],
    /// Arc length from the start to each of evenly spaced parameters.
    arc: Vec<f64>,
}

impl<'a> ByLength<'a> {
    /// Tabulates the part between two parameters, `start` < `stop`.
    pub fn new(spline: &'a Spline, start: f64, stop: f64) -> Self {
        let steps = (((stop - start) * ENTRIES_PER_SPAN) as usize).max(1);
        let step = (stop - start) / steps as f64;
        let pieces = spline.pieces();
        let speed = |u: f64| {
            let slope = pieces.at(u.min(stop)).first;
            dot(slope, slope).sqrt()
        };
        let mut arc = vec![0.0];
        let (mut total, mut before) = (0.0, speed(start));
        for i in 0..steps {
            // Simpson's rule between neighbouring entries
            let from = start + i as f64 * step;
            let after = speed(from + step);
            total += (before + 4.0 * speed(from + 0.5 * step) + after) / 6.0 * step;
            arc.push(total);
            before = after;
        }
        Self { spline, range: [start, stop], arc }
    }

    /// Returns the table: arc length from the start to each entry, metres.
    pub fn into_table(self) -> Vec<f64> {
        self.arc
    }

    /// The length of the part, metres.
    pub fn length(&self) -> f64 {
        self.arc[self.arc.len() - 1]
    }

    /// Returns the arc length at a parameter of the spline, limited to the part, metres.
    #[inline]
    pub fn arc_length(&self, parameter: f64) -> f64 {
        find_arc_length(&self.arc, self.range, parameter)
    }

    /// Returns the spline's parameter at an arc length, limited to the part.
    pub fn parameter(&self, s: f64) -> f64 {
        find_parameter(&self.arc, self.range, s)
    }

    /// Returns the place at an arc length.
    pub fn at(&self, s: f64) -> Place {
        self.spline.at(self.parameter(s))
    }

    /// Returns evenly spaced arc lengths from end to end, about `spacing` apart, at least two.
    pub fn nodes(&self, spacing: f64) -> Vec<f64> {
        let count = (self.length() / spacing).round_ties_even().max(1.0);
        (0..=count as usize).map(|i| self.length() * i as f64 / count).collect()
    }
}

/// Returns a spline's parameter at an arc length, limited to those of a table from [`ByLength`].
///
/// `arc` holds two arc lengths or more, at parameters that are evenly spaced between the first and the last.
pub(crate) fn find_parameter(arc: &[f64], [first, last]: [f64; 2], s: f64) -> f64 {
    let step = (last - first) / (arc.len() - 1) as f64;
    let parameter = |i: usize| if i + 1 < arc.len() { first + i as f64 * step } else { last };
    match arc.partition_point(|&a| a <= s) {
        0 => first,
        next if next == arc.len() => last,
        next => {
            let (low, high) = (parameter(next - 1), parameter(next));
            low + (high - low) / (arc[next] - arc[next - 1]) * (s - arc[next - 1])
        }
    }
}

/// Returns the arc length at a spline's parameter, limited to those of a table as in [`find_parameter`].
#[inline]
pub(crate) fn find_arc_length(arc: &[f64], [first, last]: [f64; 2], parameter: f64) -> f64 {
    let entries = (arc.len() - 1) as f64;
    let place = ((parameter - first) * (entries / (last - first))).clamp(0.0, entries);
    let entry = cut_off(place).min(arc.len() as u32 - 2);
    let i = entry as usize;
    arc[i] + (place - f64::from(entry)) * (arc[i + 1] - arc[i])
}

/// Returns the unit tangent at a place.
pub(crate) fn unit_tangent(place: &Place) -> Point {
    normalized(place.first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_length_and_parameter_are_each_others_inverse() {
        let nodes: Vec<Point> = (0..100)
            .map(|i| f64::from(i) * 0.05)
            .map(|a| [0.05 * a.cos(), 0.05 * a.sin(), 0.01 * a])
            .collect();
        let spline = Spline::through(&nodes, 0.01, 0.0).unwrap();
        let whole = ByLength::new(&spline, 0.0, spline.end());
        assert!((whole.length() / spline.length() - 1.0).abs() < 1e-6);
        for s in whole.nodes(0.001) {
            assert!((whole.arc_length(whole.parameter(s)) - s).abs() < 1e-12);
        }
        let part = ByLength::new(&spline, whole.parameter(0.05), whole.parameter(0.1));
        assert!((part.length() - 0.05).abs() < 1e-6);
        assert_eq!(part.arc_length(0.0), 0.0);
        assert_eq!(part.arc_length(spline.end()), part.length());
    }

    #[test]
    fn tables_lead_from_parameters_to_arc_lengths_and_back() {
        let nodes: Vec<Point> =
            (0..40).map(|i| f64::from(i) * 0.01).map(|x| [x, x * x, 0.1 * x.sin()]).collect();
        let spline = Spline::through(&nodes, 0.03, 0.0).unwrap();
        let range = [0.7, spline.end() - 1.3];
        let part = ByLength::new(&spline, range[0], range[1]);
        let (length, table) = (part.length(), part.into_table());
        let step = (range[1] - range[0]) / (table.len() - 1) as f64;
        for (i, &s) in table.iter().enumerate() {
            let u = range[0] + i as f64 * step;
            assert!((find_arc_length(&table, range, u) - s).abs() < 1e-14);
            assert!((find_parameter(&table, range, s) - u).abs() < 1e-12);
        }
        for s in (1..100).map(|i| f64::from(i) * 0.01 * length) {
            let u = find_parameter(&table, range, s);
            assert!((find_arc_length(&table, range, u) - s).abs() < 1e-14);
        }
        for (s, u) in [(-1.0, range[0]), (0.0, range[0]), (length, range[1]), (9.0, range[1])] {
            assert_eq!(find_parameter(&table, range, s), u);
        }
        assert_eq!(find_arc_length(&table, range, -1.0), 0.0);
        assert_eq!(find_arc_length(&table, range, 99.0), length);
    }
}
