//! Means of colours over chosen pixels of squares, from sums over all pixels above and to the left.

use super::{Planes, size};

/// Sums of three numbers and counts of chosen pixels.
pub struct Sums {
    width: usize,
    height: usize,
    sums: Vec<[f64; 4]>,
}

impl Sums {
    pub fn new(planes: &Planes, chosen: impl Fn(usize) -> bool) -> Self {
        let [width, height] = size(planes);
        let mut sums = vec![[0.0f64; 4]; (width + 1) * (height + 1)];
        for y in 0..height {
            let (above, here) = sums[y * (width + 1)..(y + 2) * (width + 1)].split_at_mut(width + 1);
            let mut row = [0.0f64; 4];
            for x in 0..width {
                let k = y * width + x;
                if chosen(k) {
                    for (sum, plane) in row.iter_mut().zip(planes) {
                        *sum += f64::from(plane.values[k]);
                    }
                    row[3] += 1.0;
                }
                for ((to, above), own) in here[x + 1].iter_mut().zip(above[x + 1]).zip(row) {
                    *to = above + own;
                }
            }
        }
        Self { width, height, sums }
    }

    /// Returns the mean over the chosen pixels at most `reach` rows and columns away, and the share of chosen pixels.
    pub fn mean(&self, x: usize, y: usize, reach: usize) -> ([f32; 3], f32) {
        let (left, right) = (x.saturating_sub(reach), (x + reach + 1).min(self.width));
        let (top, bottom) = (y.saturating_sub(reach), (y + reach + 1).min(self.height));
        self.mean_of([left, right], [top, bottom])
    }

    /// Returns the mean over all chosen pixels.
    pub fn total(&self) -> [f32; 3] {
        self.mean_of([0, self.width], [0, self.height]).0
    }

    fn mean_of(&self, [left, right]: [usize; 2], [top, bottom]: [usize; 2]) -> ([f32; 3], f32) {
        let at = |x: usize, y: usize| self.sums[y * (self.width + 1) + x];
        let (a, b, c, d) = (at(left, top), at(right, top), at(left, bottom), at(right, bottom));
        let sum = [0, 1, 2, 3].map(|k| d[k] - b[k] - c[k] + a[k]);
        let count = sum[3].max(1e-6);
        let area = ((right - left) * (bottom - top)).max(1) as f64;
        ([0, 1, 2].map(|k| (sum[k] / count) as f32), (sum[3] / area) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::image::Image;

    #[test]
    fn means_are_those_of_brute_force() {
        let (width, height) = (9, 7);
        let planes = [3usize, 5, 7].map(|step| Image {
            width,
            height,
            values: (0..width * height).map(|k| (k * step % 11) as f32).collect(),
        });
        let chosen = |k: usize| k % 3 != 1;
        let sums = Sums::new(&planes, chosen);
        for (x, y, reach) in [(0, 0, 2), (4, 3, 1), (8, 6, 3), (5, 2, 20)] {
            let own: Vec<usize> = (0..width * height)
                .filter(|&k| {
                    (k % width).abs_diff(x) <= reach && (k / width).abs_diff(y) <= reach && chosen(k)
                })
                .collect();
            let (mean, _) = sums.mean(x, y, reach);
            for (plane, mean) in planes.iter().zip(mean) {
                let brute = own.iter().map(|&k| plane.values[k]).sum::<f32>() / own.len() as f32;
                assert!((brute - mean).abs() < 1e-4);
            }
        }
    }
}
