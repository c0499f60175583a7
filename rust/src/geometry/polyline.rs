//! Polylines in the image or in space.

/// Returns the arc length from the first node to each node.
pub fn arc_length<const N: usize>(nodes: &[[f64; N]]) -> Vec<f64> {
    let mut total = 0.0;
    let mut lengths = Vec::with_capacity(nodes.len().max(1));
    lengths.push(0.0);
    for pair in nodes.windows(2) {
        total += (0..N).map(|k| (pair[1][k] - pair[0][k]).powi(2)).sum::<f64>().sqrt();
        lengths.push(total);
    }
    lengths
}

/// Returns rows of values at places, linear between those at known places in order, at least two; the outermost lines
/// go on beyond them.
///
/// A row has as many values as its known place has, and `values` holds the rows one after the other.
pub fn interpolate_rows(places: &[f64], known: &[f64], values: &[f64]) -> Vec<f64> {
    let width = values.len() / known.len();
    let mut rows = Vec::with_capacity(places.len() * width);
    for &place in places {
        let next = known.partition_point(|&there| there <= place).clamp(1, known.len() - 1);
        let part = (place - known[next - 1]) / (known[next] - known[next - 1]);
        let (before, after) = values[(next - 1) * width..(next + 1) * width].split_at(width);
        rows.extend(before.iter().zip(after).map(|(low, high)| (1.0 - part) * low + part * high));
    }
    rows
}

/// Counts the points that are nearest to each of some nodes, and the views that they come from.
///
/// Points are given by their arc lengths and views, view by view. Nodes are `spacing` apart along the same curve.
pub fn count_seen(arc_lengths: &[f64], views: &[i64], spacing: f64, nodes: usize) -> [Vec<i64>; 2] {
    let (mut points, mut cameras, mut before) = (vec![0; nodes], vec![0; nodes], vec![None; nodes]);
    let Some(last) = nodes.checked_sub(1) else { return [points, cameras] };
    for (&s, &view) in arc_lengths.iter().zip(views) {
        let nearest = ((s / spacing).round_ties_even() as usize).min(last);
        points[nearest] += 1;
        cameras[nearest] += i64::from(before[nearest] != Some(view));
        before[nearest] = Some(view);
    }
    [points, cameras]
}

/// Resamples a polyline evenly from end to end: nodes about `step` apart, at least two.
pub fn resampled<const N: usize>(nodes: &[[f64; N]], step: f64) -> Vec<[f64; N]> {
    let arc = arc_length(nodes);
    let length = arc[arc.len() - 1];
    let count = ((length / step).round() as u32).max(1);
    let mut i = 0;
    (0..=count)
        .map(|k| {
            let s = length * f64::from(k) / f64::from(count);
            while i + 2 < arc.len() && arc[i + 1] < s {
                i += 1;
            }
            let Some(next) = nodes.get(i + 1) else { return nodes[i] };
            let part = arc[i + 1] - arc[i];
            let t = if part > 0.0 { ((s - arc[i]) / part).clamp(0.0, 1.0) } else { 0.0 };
            std::array::from_fn(|k| nodes[i][k] + t * (next[k] - nodes[i][k]))
        })
        .collect()
}

/// Smooths nodes `times` times by binomial weights; the end nodes stay.
pub fn smoothed<const N: usize>(nodes: &[[f64; N]], times: usize) -> Vec<[f64; N]> {
    let mut nodes = nodes.to_vec();
    for _ in 0..times {
        let Some(&first) = nodes.first() else { break };
        let mut before = first;
        for i in 1..nodes.len().saturating_sub(1) {
            let here = nodes[i];
            nodes[i] = std::array::from_fn(|k| 0.25 * before[k] + 0.5 * here[k] + 0.25 * nodes[i + 1][k]);
            before = here;
        }
    }
    nodes
}

/// Appends the unit directions at the nodes: by central differences, one-sided at the ends, 0 where nodes coincide.
pub fn append_directions<const N: usize>(nodes: &[[f64; N]], into: &mut Vec<[f64; N]>) {
    let last = nodes.len().saturating_sub(1);
    into.extend((0..nodes.len()).map(|i| {
        let (a, b) = (nodes[i.saturating_sub(1)], nodes[(i + 1).min(last)]);
        let d: [f64; N] = std::array::from_fn(|k| b[k] - a[k]);
        let length = d.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-12);
        d.map(|x| x / length)
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_point_counts_at_its_nearest_node_and_each_view_once() {
        let s = [-3.0, 0.2, 1.4, 9.0, 0.9, 1.1, 0.6];
        let [points, cameras] = count_seen(&s, &[0, 0, 0, 0, 1, 1, 4], 1.0, 3);
        assert_eq!((points, cameras), (vec![2, 4, 1], vec![1, 3, 1]));
        assert_eq!(count_seen(&s, &[0; 7], 1.0, 0), [Vec::<i64>::new(), Vec::new()]);
    }

    #[test]
    fn nodes_are_evenly_spaced_from_end_to_end() {
        let bent = [[0.0, 0.0], [3.0, 0.0], [3.0, 0.0], [3.0, 1.0]];
        let nodes = resampled(&bent, 0.9);
        assert_eq!(nodes, [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [3.0, 1.0]]);
        assert_eq!(resampled(&bent[1..3], 0.9).len(), 2);
        assert_eq!(smoothed(&nodes, 2)[4], [3.0, 1.0]);
        assert_eq!(smoothed(&nodes, 1)[3], [2.75, 0.25]);
        let mut directed = Vec::new();
        append_directions(&nodes, &mut directed);
        assert_eq!(directed[4], [0.0, 1.0]);
    }
}
