//! Polylines in the image.

/// Column and row, pixels.
pub type Place = [f64; 2];

/// The length of a vector.
#[inline]
pub fn norm(d: Place) -> f64 {
    (d[0] * d[0] + d[1] * d[1]).sqrt()
}

/// The distance between two places.
#[inline]
pub fn apart(a: Place, b: Place) -> f64 {
    norm([a[0] - b[0], a[1] - b[1]])
}

/// The length of a polyline.
pub fn length(p: &[Place]) -> f64 {
    p.windows(2).map(|w| apart(w[0], w[1])).sum()
}

/// Arc length at each node.
pub fn arc_length(p: &[Place]) -> Vec<f64> {
    let mut s = Vec::with_capacity(p.len());
    let mut sum = 0.0;
    for (i, &x) in p.iter().enumerate() {
        if i > 0 {
            sum += apart(p[i - 1], x);
        }
        s.push(sum);
    }
    s
}

/// Nodes evenly along a polyline, about `step` apart, at least two.
pub fn resampled(p: &[Place], step: f64) -> Vec<Place> {
    let s = arc_length(p);
    let total = s[s.len() - 1];
    let n = ((total / step).round() as usize + 1).max(2);
    let mut k = 0;
    (0..n)
        .map(|i| {
            let t = total * i as f64 / (n - 1) as f64;
            while k + 2 < p.len() && s[k + 1] < t {
                k += 1;
            }
            if p.len() < 2 || s[k + 1] <= s[k] {
                return p[k];
            }
            let a = ((t - s[k]) / (s[k + 1] - s[k])).clamp(0.0, 1.0);
            [p[k][0] + a * (p[k + 1][0] - p[k][0]), p[k][1] + a * (p[k + 1][1] - p[k][1])]
        })
        .collect()
}

/// Smoothed `times` with the weights ¼, ½, ¼; the ends stay.
pub fn smoothed(p: &[Place], times: usize) -> Vec<Place> {
    let mut p = p.to_vec();
    for _ in 0..times {
        let mut before = p[0];
        for i in 1..p.len().saturating_sub(1) {
            let here = p[i];
            for c in 0..2 {
                p[i][c] = 0.25 * before[c] + 0.5 * here[c] + 0.25 * p[i + 1][c];
            }
            before = here;
        }
    }
    p
}

/// A unit vector; zero for zero.
pub fn unit(d: Place) -> Place {
    let n = norm(d).max(1e-9);
    [d[0] / n, d[1] / n]
}

/// Without repeated nodes, evenly spaced and a little smoothed.
pub fn cleaned(p: &[Place], step: f64) -> Vec<Place> {
    let mut kept: Vec<Place> = Vec::with_capacity(p.len());
    for &x in p {
        if kept.last().is_none_or(|&last| apart(last, x) > 1e-6) {
            kept.push(x);
        }
    }
    smoothed(&resampled(&kept, step), 2)
}

/// The cubic from `a` with direction `ta` to `b` with direction `tb`.
pub fn hermite(a: Place, ta: Place, b: Place, tb: Place) -> Vec<Place> {
    let long = apart(a, b);
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

/// r ∫ κ² ds and r³ ∫ κ'² ds.
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

/// The longest step between nodes.
pub fn longest_step(p: &[Place]) -> f64 {
    p.windows(2).map(|w| apart(w[0], w[1])).fold(0.0, f64::max)
}

/// The node nearest to a place, and its distance; none if none is nearer than `within`.
///
/// `step` is the longest between nodes: from one that is far, as many are left out as cannot be near.
#[inline]
pub fn nearest_node(x: Place, p: &[Place], step: f64, within: f64) -> Option<(usize, f64)> {
    let (mut least, mut found) = (within, None);
    let mut i = 0;
    while i < p.len() {
        let away = apart(x, p[i]);
        if away < least {
            (least, found) = (away, Some(i));
        }
        i += (((away - least) / step) as usize).max(1);
    }
    found.map(|i| (i, least))
}

/// The least distance between the nodes of two polylines.
pub fn nearest(p: &[Place], q: &[Place]) -> f64 {
    let step = longest_step(q).max(1e-9);
    let mut least = f64::INFINITY;
    for &x in p {
        if let Some((_, away)) = nearest_node(x, q, step, least) {
            least = away;
        }
    }
    least
}

/// Whether two polylines cross.
pub fn cross(p: &[Place], q: &[Place]) -> bool {
    p.windows(2).any(|s| q.windows(2).any(|t| crossing(s[0], s[1], t[0], t[1]).is_some()))
}

/// Where two line segments cross, as shares of each.
pub fn crossing(a: Place, b: Place, c: Place, d: Place) -> Option<(f64, f64)> {
    let (x, y) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
    let (w, across) = ([c[0] - a[0], c[1] - a[1]], x[0] * y[1] - x[1] * y[0]);
    if across == 0.0 {
        return None;
    }
    let t = (w[0] * y[1] - w[1] * y[0]) / across;
    let u = (w[0] * x[1] - w[1] * x[0]) / across;
    ((0.0..1.0).contains(&t) && (0.0..1.0).contains(&u)).then_some((t, u))
}
