//! Points in an order in which near points are beside each other.

use super::bounds::Bounds;
use crate::geometry::Point;
use crate::parallel::go_on;
use crate::simd::BATCH;

const MIN_SHARED: usize = 2048; // fewer points are divided by one thread

/// Orders at most 2³² finite points so that each [`BATCH`] of them are near each other; returns their indices.
///
/// Boxes are halved across their longest side until a box holds one batch. All batches but the last are full.
pub fn halve(points: &[Point]) -> Vec<u32> {
    let mut keyed: Vec<u64> = (0..points.len() as u64).collect();
    divide(points, &mut keyed);
    keyed.iter().map(|&word| word as u32).collect()
}

/// Divides points whose indices are the low halves of words.
fn divide(points: &[Point], some: &mut [u64]) {
    if some.len() <= BATCH {
        return;
    }
    let mut bounds = Bounds::NONE;
    for &word in some.iter() {
        bounds.add(points[word as u32 as usize]);
    }
    let longest = bounds.longest();
    let (low, inverse) = (bounds.low[longest], 1.0 / bounds.sides()[longest].max(f64::MIN_POSITIVE));
    for word in some.iter_mut() {
        let index = *word as u32;
        // the bits of floats without a sign have their order, and −0 has a sign; equals go by their index
        let along = ((points[index as usize][longest] - low) * inverse).abs() as f32;
        *word = u64::from(along.to_bits()) << 32 | u64::from(index);
    }
    let middle = (some.len() / 2).next_multiple_of(BATCH);
    some.select_nth_unstable(middle);
    let shared = some.len() >= MIN_SHARED;
    let (one, other) = some.split_at_mut(middle);
    if shared {
        go_on();
        rayon::join(|| divide(points, one), || divide(points, other));
    } else {
        divide(points, one);
        divide(points, other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_point_is_in_one_batch_of_near_points() {
        // a plane of 60 by 60 points in no order, and points that coincide
        let places = (0..3600).map(|i| i * 1571 % 3600);
        let plane: Vec<Point> = places.map(|i| [f64::from(i / 60), f64::from(i % 60), 7.0]).collect();
        for points in [plane, vec![[0.5; 3]; 100], Vec::new()] {
            let order = halve(&points);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.iter().copied().eq(0..points.len() as u32));
            for batch in order.chunks(BATCH) {
                let mut bounds = Bounds::NONE;
                batch.iter().for_each(|&i| bounds.add(points[i as usize]));
                assert!(bounds.diagonal() < 9.0);
            }
        }
    }

    #[test]
    fn both_zeros_are_the_same_place() {
        let zero = |i: i32| if i % 2 == 0 { 0.0 } else { -0.0 };
        let place = |i: i32| [if i < 50 { zero(i) } else { f64::from(i) }, 0.0, 0.0];
        let points: Vec<Point> = (0..100).map(place).collect();
        assert!(halve(&points)[..48].iter().all(|&i| i < 50));
    }
}
