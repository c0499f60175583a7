//! Points and vectors.

/// A point or vector: x, y, z.
pub type Point = [f64; 3];

#[inline]
pub fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns a / |a|, or a itself if it has no length.
#[inline]
pub fn normalized(a: Point) -> Point {
    let length = dot(a, a).sqrt();
    if length > 0.0 { [a[0] / length, a[1] / length, a[2] / length] } else { a }
}

/// Returns p + s d.
#[inline]
pub fn advance(p: Point, s: f64, d: Point) -> Point {
    [p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2]]
}

#[inline]
pub fn squared_distance(a: Point, b: Point) -> f64 {
    let d = sub(a, b);
    dot(d, d)
}

/// Returns the cell of a lattice around a place. Whole negative numbers fall into the cell below, which saves a call to
/// floor.
#[inline]
pub fn cell_of(p: Point, cell: f64) -> [i64; 3] {
    let inverse = 1.0 / cell;
    let mut cells = [0; 3];
    for k in 0..3 {
        let place = p[k] * inverse;
        cells[k] = (place as i64).saturating_sub(i64::from(place < 0.0));
    }
    cells
}

/// Returns a number without its fraction: 0 for less than 1 and for NaN, at most 2³² − 1.
///
/// It finds cells, pixels and spans. On processors of every age, a cast to 32 bits and back takes a few instructions. One
/// to 64 bits without a sign takes about three times as many, and `floor` is a call.
#[inline(always)]
pub fn cut_off(x: f64) -> u32 {
    x as u32
}

/// Returns the mean of points; the origin for none. It adds them in order, so equal input gives equal bits.
pub fn centroid(points: &[Point]) -> Point {
    let mut sum = [0.0; 3];
    for p in points {
        for k in 0..3 {
            sum[k] += p[k];
        }
    }
    sum.map(|x| x / points.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_cut_off_like_floor_from_zero_on() {
        for x in [0.0, 0.4, 0.999_999_999_999_999_9, 1.0, 7.5, 4_294_967_295.9] {
            assert_eq!(f64::from(cut_off(x)), f64::floor(x));
        }
        assert_eq!([-0.5, -3.0, f64::NEG_INFINITY, f64::NAN].map(cut_off), [0; 4]);
        assert_eq!([1e10, f64::INFINITY].map(cut_off), [u32::MAX; 2]);
    }
}
