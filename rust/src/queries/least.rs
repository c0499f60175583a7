//! Minima of convex functions made of parabolas, as the squared distance of a moving point from a box or a segment.

/// Finds the place from 0 to 1 at which a convex function is least; the first one, or nearly so, if there are several.
///
/// The slope increases, and is linear between the `breaks`. These may be in any order, out of range, or NaN.
#[inline(always)]
pub fn least_place<const N: usize>(slope: impl Fn(f64) -> f64, breaks: [f64; N]) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    let (mut at_low, mut at_high) = (slope(low), slope(high));
    if at_low >= 0.0 {
        return low;
    }
    if at_high <= 0.0 {
        return high;
    }
    for place in breaks {
        if low < place && place < high {
            let there = slope(place);
            if there < 0.0 {
                (low, at_low) = (place, there);
            } else {
                (high, at_high) = (place, there);
            }
        }
    }
    low + (high - low) * (at_low / (at_low - at_high))
}

#[cfg(test)]
mod tests {
    use super::least_place;

    #[test]
    fn the_least_place_is_found_between_breaks_at_them_and_at_the_ends() {
        // max(1 − 4 x, 0)² + max(x − b, 0)²
        let place = |b: f64| {
            let slope = |x: f64| -4.0 * (1.0 - 4.0 * x).max(0.0) + (x - b).max(0.0);
            least_place(slope, [b, f64::NAN, 0.25, f64::INFINITY])
        };
        assert_eq!(place(0.5), 0.25);
        assert!((place(0.1) - 4.1 / 17.0).abs() < 1e-15);
        assert_eq!(least_place(|x| x + 1.0, []), 0.0);
        assert_eq!(least_place(|x| x - 1.0, []), 1.0);
        assert_eq!(least_place(|_| 0.0, [0.5]), 0.0);
    }
}
