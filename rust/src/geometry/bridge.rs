//! Curves that bridge gaps between pieces of rope.

use super::polyline::arc_length;
use super::vector::{Point, advance, cross, dot, sub};
use crate::checks::check_positive;
use crate::error::{Error, Result};

const TOUCHING: f64 = 1.2; // ends nearer than this touch or overlap, radii
const MAX_TURN: f64 = 1.4; // largest turn of a joining curve at each of its ends, radians

const MAX_NODES: f64 = 1e6; // nodes of a bridge at most

/// Returns the unit vector out of the last node, over `span` of arc length that ends `skip` before it.
///
/// A shorter chain gives the direction of the whole chain. A single node, or none, gives the zero vector.
pub(crate) fn find_end_direction(nodes: &[Point], skip: f64, span: f64) -> Point {
    let backwards: Vec<Point> = nodes.iter().rev().copied().collect();
    let Some(last) = nodes.len().checked_sub(1) else { return [0.0; 3] };
    let back = arc_length(&backwards);
    let [mut near, mut far] =
        [skip, skip + span].map(|length| back.partition_point(|&s| s < length).min(last));
    if near == far {
        (near, far) = (0, last);
    }
    let step = sub(backwards[near], backwards[far]);
    let length = dot(step, step).sqrt();
    if length > 0.0 { step.map(|x| x / length) } else { step }
}

/// Returns the inner nodes of the cubic from the last node of `before` to the first node of `after`.
///
/// The direction at each end is taken over `span` of its piece. `reach` holds the lengths of the tangents at the two
/// ends, as shares of the gap.
pub(crate) fn bridge(
    before: &[Point],
    after: &[Point],
    span: f64,
    spacing: f64,
    reach: [f64; 2],
) -> Result<Vec<Point>> {
    check_positive("spacing", spacing)?;
    let (Some(&start), Some(&stop)) = (before.last(), after.first()) else { return Ok(Vec::new()) };
    let step = sub(stop, start);
    let gap = dot(step, step).sqrt();
    let nodes = gap / spacing;
    if nodes.is_nan() || nodes > MAX_NODES {
        let reason = format!("expected a gap of less than {MAX_NODES:e} spacings, got {gap} m / {spacing} m");
        return Err(Error::invalid("spacing", reason));
    }
    let count = nodes as usize + 1;
    let backwards: Vec<Point> = after.iter().rev().copied().collect();
    let leave = find_end_direction(before, 0.0, span).map(|x| x * gap * reach[0]);
    let arrive = find_end_direction(&backwards, 0.0, span).map(|x| -x * gap * reach[1]);
    let hermite = |i: usize| {
        let t = i as f64 / count as f64;
        let (square, cube) = (t * t, t * t * t);
        std::array::from_fn(|k| {
            (2.0 * cube - 3.0 * square + 1.0) * start[k]
                + (cube - 2.0 * square + t) * leave[k]
                + (3.0 * square - 2.0 * cube) * stop[k]
                + (cube - square) * arrive[k]
        })
    };
    Ok((1..count).map(hermite).collect())
}

/// Returns the cost of joining two ends by a curve that leaves p along `leave` and arrives at q, which points along
/// `arrive`.
///
/// A gap L with the turns a and b at its ends costs the sum of
/// - 2 (a² + b²),
/// - the bending energy of a cubic, (8 r / L) (a² + b² − a b),
/// - 0.25 L / r.
///
/// Ends that touch or overlap cost their turn and their sideways offset. The cost is infinite if the curve would have to
/// turn back.
pub(crate) fn price_join(p: Point, leave: Point, q: Point, arrive: Point, radius: f64) -> f64 {
    let angle = |a: Point, b: Point| dot(a, b).clamp(-1.0, 1.0).acos();
    let step = sub(q, p);
    let gap = dot(step, step).sqrt();
    let onwards = arrive.map(|x| -x);
    if gap < TOUCHING * radius {
        let turn = angle(leave, onwards);
        let aside = advance(step, -dot(step, leave), leave);
        let aside = dot(aside, aside).sqrt() / (0.5 * radius);
        return 1.5 * turn * turn + 0.5 * aside * aside;
    }
    let straight = step.map(|x| x / gap);
    let (a, b) = (angle(leave, straight), angle(onwards, straight));
    if a.max(b) > MAX_TURN {
        return f64::INFINITY;
    }
    let together = dot(cross(leave, straight), cross(straight, onwards));
    let energy = 8.0 * radius / gap * (a * a + b * b - together);
    2.0 * (a * a + b * b) + energy + 0.25 * gap / radius
}

/// Returns the bending energy of a polyline, ∫κ² ds, 1/m.
pub(crate) fn measure_bending(nodes: &[Point]) -> f64 {
    let steps: Vec<Point> = nodes.windows(2).map(|pair| sub(pair[1], pair[0])).collect();
    let lengths: Vec<f64> = steps.iter().map(|&step| dot(step, step).sqrt()).collect();
    let turn = |i: usize| {
        let cosine = dot(steps[i], steps[i + 1]) / (lengths[i].max(1e-12) * lengths[i + 1].max(1e-12));
        cosine.clamp(-1.0, 1.0).acos().powi(2) / (0.5 * (lengths[i] + lengths[i + 1])).max(1e-12)
    };
    (0..steps.len().saturating_sub(1)).map(turn).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(from: f64, to: f64) -> Vec<Point> {
        (0..=10).map(|i| [from + (to - from) * f64::from(i) / 10.0, 0.0, 0.0]).collect()
    }

    #[test]
    fn a_bridge_between_two_ends_of_a_line_is_straight() {
        let nodes = bridge(&line(0.0, 1.0), &line(2.0, 3.0), 0.5, 0.1, [1.0, 1.0]).unwrap();
        assert_eq!(nodes.len(), 10);
        assert!(nodes.iter().all(|p| p[0] > 1.0 && p[0] < 2.0 && p[1] == 0.0 && p[2] == 0.0));
        assert!(measure_bending(&nodes) < 1e-12);
    }

    #[test]
    fn a_bridge_of_more_nodes_than_memory_holds_is_refused() {
        for spacing in [1e-12, 0.0, f64::NAN, -1.0] {
            assert!(bridge(&line(0.0, 1.0), &line(2.0, 3.0), 0.5, spacing, [1.0, 1.0]).is_err());
        }
        assert!(bridge(&line(0.0, 1.0), &line(1e9, 2e9), 0.5, 0.1, [1.0, 1.0]).is_err());
        assert!(bridge(&line(0.0, 1.0), &line(f64::NAN, 3.0), 0.5, 0.1, [1.0, 1.0]).is_err());
    }

    #[test]
    fn a_direction_skips_what_it_is_told_to() {
        let mut nodes = line(0.0, 1.0);
        nodes.push([1.0, 0.1, 0.0]);
        assert_eq!(find_end_direction(&nodes, 0.1, 0.3), [1.0, 0.0, 0.0]);
        assert_eq!(find_end_direction(&nodes, 0.0, 0.1), [0.0, 1.0, 0.0]);
        assert_eq!(find_end_direction(&nodes[..1], 0.0, 0.1), [0.0; 3]);
    }

    #[test]
    fn joins_cost_their_bends_and_none_turns_back() {
        let x = [1.0, 0.0, 0.0];
        let cost = |q, arrive| price_join([0.0; 3], x, q, arrive, 1.0);
        let ahead = cost([4.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        assert!((ahead - 1.0).abs() < 1e-12);
        assert!(cost([4.0, 1.0, 0.0], [-1.0, 0.0, 0.0]) > ahead);
        assert_eq!(cost([-4.0, 0.0, 0.0], x), f64::INFINITY);
        assert!(cost([0.5, 0.0, 0.0], [-1.0, 0.0, 0.0]) < 1e-12);
    }
}
