//! Arc length along a spline, from a table.

use super::spline::{Place, Spline};
use super::vector::{Point, dot, normalized};

const ENTRIES_PER_SPAN: f64 = 16.0; // table entries for each span; arc length is linear in the parameter between them

/// A part of a spline that is parameterized by arc length.
pub(crate) struct ByLength<'a> {
    spline: &'a Spline,
    start: f64,
    step: f64,
    /// Arc length from the start to each place.
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
        Self { spline, start, step, arc }
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
        let last = self.arc.len() - 1;
        let place = ((parameter - self.start) / self.step).clamp(0.0, last as f64);
        let i = (place as usize).min(last - 1);
        self.arc[i] + (place - i as f64) * (self.arc[i + 1] - self.arc[i])
    }

    /// Returns the spline's parameter at an arc length, limited to the part.
    pub fn parameter(&self, s: f64) -> f64 {
        let i = self.arc.partition_point(|&a| a <= s).clamp(1, self.arc.len() - 1);
        let length = self.arc[i] - self.arc[i - 1];
        let share = if length > 0.0 { ((s - self.arc[i - 1]) / length).clamp(0.0, 1.0) } else { 0.0 };
        self.start + ((i - 1) as f64 + share) * self.step
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
}
