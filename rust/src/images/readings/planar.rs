//! Polylines in the image.

use crate::geometry::cut_off;
pub use crate::geometry::polyline::{resampled, smoothed};

const SLACK: f64 = 1e-9; // share by which segments that meet may seem too far apart, by rounding

/// Column and row, pixels.
pub type Place = [f64; 2];

#[inline]
pub fn norm(d: Place) -> f64 {
    (d[0] * d[0] + d[1] * d[1]).sqrt()
}

#[inline]
pub fn distance(a: Place, b: Place) -> f64 {
    norm([a[0] - b[0], a[1] - b[1]])
}

pub fn length(p: &[Place]) -> f64 {
    p.windows(2).map(|w| distance(w[0], w[1])).sum()
}

/// Returns the unit vector; zero for zero.
pub fn unit(d: Place) -> Place {
    let n = norm(d).max(1e-9);
    [d[0] / n, d[1] / n]
}

/// Removes repeated nodes, resamples evenly and smooths a little.
pub fn cleaned(p: &[Place], step: f64) -> Vec<Place> {
    let mut kept: Vec<Place> = Vec::with_capacity(p.len());
    for &x in p {
        if kept.last().is_none_or(|&last| distance(last, x) > 1e-6) {
            kept.push(x);
        }
    }
    smoothed(&resampled(&kept, step), 2)
}

/// Returns the cubic from `a` with direction `ta` to `b` with direction `tb`.
pub fn hermite(a: Place, ta: Place, b: Place, tb: Place) -> Vec<Place> {
    let long = distance(a, b);
    (0..40)
        .map(|i| {
            let t = f64::from(i) / 39.0;
            let (t2, t3) = (t * t, t * t * t);
            let weights = [2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, 3.0 * t2 - 2.0 * t3, t3 - t2];
            [0, 1].map(|c| {
                weights[0] * a[c] + weights[1] * ta[c] * long + weights[2] * b[c] + weights[3] * tb[c] * long
            })
        })
        .collect()
}

/// Returns r ∫ κ² ds and r³ ∫ κ'² ds.
pub fn bending(p: &[Place], radius: f64) -> (f64, f64) {
    let h = length(p) / (p.len().max(2) - 1) as f64 / radius;
    let sum = |weights: &[f64]| -> f64 {
        p.windows(weights.len())
            .map(|w| {
                (0..2).map(|c| w.iter().zip(weights).map(|(x, k)| x[c] * k).sum::<f64>().powi(2)).sum::<f64>()
            })
            .sum()
    };
    let square = radius * radius;
    (sum(&[1.0, -2.0, 1.0]) / square / h.powi(3), sum(&[-1.0, 3.0, -3.0, 1.0]) / square / h.powi(5))
}

/// Returns the longest step between nodes.
pub fn find_longest_step(p: &[Place]) -> f64 {
    p.windows(2).map(|w| distance(w[0], w[1])).fold(0.0, f64::max)
}

/// Returns the node nearest to a place, and its distance; None if there is none nearer than `within`.
///
/// `step` is the longest step between nodes: from a far node, the search skips those that cannot be near.
#[inline]
pub fn find_nearest_node(x: Place, p: &[Place], step: f64, within: f64) -> Option<(usize, f64)> {
    let (mut least, mut found) = (within, None);
    let inverse = 1.0 / step;
    let mut i = 0;
    while i < p.len() {
        let away = distance(x, p[i]);
        if away < least {
            (least, found) = (away, Some(i));
        }
        i += (cut_off((away - least) * inverse) as usize).max(1);
    }
    found.map(|i| (i, least))
}

/// Returns the least distance between the nodes of two polylines, if it is less than `within`.
pub fn nearest(p: &[Place], q: &[Place], within: f64) -> Option<f64> {
    let step = find_longest_step(q).max(1e-9);
    let mut least = None;
    for &x in p {
        if let Some((_, away)) = find_nearest_node(x, q, step, least.unwrap_or(within)) {
            least = Some(away);
        }
    }
    least
}

/// Returns whether two polylines cross.
pub fn cross(p: &[Place], q: &[Place]) -> bool {
    // segments that meet begin no farther apart than both are long together
    let longest = find_longest_step(q).max(1e-9);
    let inverse = 1.0 / longest;
    p.windows(2).any(|s| {
        let reach = (1.0 + SLACK) * (distance(s[0], s[1]) + longest);
        let mut j = 0;
        while j + 1 < q.len() {
            let away = distance(s[0], q[j]);
            if away <= reach && cross_segments(s[0], s[1], q[j], q[j + 1]).is_some() {
                return true;
            }
            j += (cut_off((away - reach) * inverse) as usize).max(1);
        }
        false
    })
}

/// Returns where two segments cross, as shares of each; None if they do not.
pub fn cross_segments(a: Place, b: Place, c: Place, d: Place) -> Option<(f64, f64)> {
    let (x, y) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
    let (w, across) = ([c[0] - a[0], c[1] - a[1]], x[0] * y[1] - x[1] * y[0]);
    if across == 0.0 {
        return None;
    }
    let t = (w[0] * y[1] - w[1] * y[0]) / across;
    let u = (w[0] * x[1] - w[1] * x[0]) / across;
    ((0.0..1.0).contains(&t) && (0.0..1.0).contains(&u)).then_some((t, u))
}
