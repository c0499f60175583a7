//! Smaller copies of images, and values between their pixels.

use super::Planes;
use crate::images::image::Image;

/// Makes an image smaller by a factor of at least 1: each pixel is the mean of the area that it covers.
pub fn shrunk(image: &Image<f32>, size: [usize; 2]) -> Image<f32> {
    let [width, height] = size;
    if size == [image.width, image.height] {
        return image.clone();
    }
    let (across, down) = (find_shares(image.width, width), find_shares(image.height, height));
    let mut values = Vec::with_capacity(width * height);
    let mut row = vec![0.0f32; image.width];
    for (first, weights) in &down {
        row.fill(0.0);
        for (n, weight) in weights.iter().enumerate() {
            for (sum, value) in row.iter_mut().zip(&image.values[(first + n) * image.width..]) {
                *sum += weight * value;
            }
        }
        values.extend(across.iter().map(|(first, weights)| {
            weights.iter().zip(&row[*first..]).map(|(weight, value)| weight * value).sum::<f32>()
        }));
    }
    Image { width, height, values }
}

/// Makes planes smaller, as [`shrunk`].
pub fn shrunk_planes(planes: &Planes, size: [usize; 2]) -> Planes {
    [0, 1, 2].map(|k| shrunk(&planes[k], size))
}

/// Returns which of `many` cells each of `few` covers: the first one, and the shares of it and of those after it.
fn find_shares(many: usize, few: usize) -> Vec<(usize, Vec<f32>)> {
    let scale = many as f64 / few as f64;
    let share = |cell: usize, low: f64, high: f64| {
        ((high.min(cell as f64 + 1.0) - low.max(cell as f64)) / scale).max(0.0) as f32
    };
    (0..few)
        .map(|k| {
            let (low, high) = (k as f64 * scale, (k + 1) as f64 * scale);
            let (first, last) = (low as usize, (high.ceil() as usize).clamp(1, many));
            (first, (first..last).map(|cell| share(cell, low, high)).collect())
        })
        .collect()
}

/// Where the pixels of a large row or column lie among those of a small one: the first of two, and the second one's weight.
pub fn find_places(large: usize, small: usize) -> Vec<(usize, f32)> {
    let scale = small as f64 / large as f64;
    (0..large)
        .map(|k| {
            let place = ((k as f64 + 0.5) * scale - 0.5).clamp(0.0, small as f64 - 1.0);
            let first = (place as usize).min(small.saturating_sub(2));
            (first, (place - first as f64) as f32)
        })
        .collect()
}

/// Interpolates between four pixels.
#[inline(always)]
pub fn interpolate(image: &Image<f32>, (i, a): (usize, f32), (j, b): (usize, f32)) -> f32 {
    let next = usize::from(i + 1 < image.width);
    let below = if j + 1 < image.height { image.width } else { 0 };
    let k = j * image.width + i;
    let v = &image.values;
    let upper = v[k] * (1.0 - a) + v[k + next] * a;
    let lower = v[k + below] * (1.0 - a) + v[k + below + next] * a;
    upper * (1.0 - b) + lower * b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_images_keep_the_mean_and_whole_factors_average_squares() {
        let values = (0..12 * 8).map(|k| ((k * 37) % 19) as f32).collect();
        let image = Image { width: 12, height: 8, values };
        let mean = |image: &Image<f32>| image.values.iter().sum::<f32>() / image.values.len() as f32;
        for size in [[6, 4], [8, 5], [5, 3], [12, 8]] {
            assert!((mean(&shrunk(&image, size)) - mean(&image)).abs() < 1e-4);
        }
        let half = shrunk(&image, [6, 4]);
        let square = (image.at(2, 4) + image.at(3, 4) + image.at(2, 5) + image.at(3, 5)) / 4.0;
        assert!((half.at(1, 2) - square).abs() < 1e-5);
        assert_eq!(find_places(4, 2), [(0, 0.0), (0, 0.25), (0, 0.75), (0, 1.0)]);
    }
}
