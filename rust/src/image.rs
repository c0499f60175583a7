//! Images of small integers and reals, and what is counted in them: blobs, distances.

/// An image of `width` columns, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Image<T> {
    pub width: usize,
    pub height: usize,
    pub values: Vec<T>,
}

impl<T: Copy> Image<T> {
    /// An image of one value.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    /// The value at a column and row.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> T {
        self.values[y * self.width + x]
    }

    /// Sets the value at a column and row.
    #[inline(always)]
    pub fn set(&mut self, x: usize, y: usize, value: T) {
        self.values[y * self.width + x] = value;
    }
}

impl Image<f32> {
    /// The value between pixels, bilinear; beyond the border as on it.
    #[inline]
    pub fn between(&self, x: f64, y: f64) -> f64 {
        let x = x.clamp(0.0, (self.width - 1) as f64);
        let y = y.clamp(0.0, (self.height - 1) as f64);
        let (i, j) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (a, b) = (x - i as f64, y - j as f64);
        let k = j * self.width + i;
        let v = &self.values;
        let above = f64::from(v[k]) * (1.0 - a) + f64::from(v[k + 1]) * a;
        let below = f64::from(v[k + self.width]) * (1.0 - a) + f64::from(v[k + self.width + 1]) * a;
        above * (1.0 - b) + below * b
    }

    /// Smoothed with a Gaussian of this standard deviation, pixels; the border is repeated.
    pub fn smoothed(&self, deviation: f64) -> Self {
        let reach = (3.0 * deviation).ceil() as usize;
        let mut kernel: Vec<f32> =
            (0..=reach).map(|i| (-0.5 * (i as f64 / deviation).powi(2)).exp() as f32).collect();
        let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
        kernel.iter_mut().for_each(|k| *k /= sum);
        let (w, h) = (self.width, self.height);
        let mut rows = vec![0.0f32; w * h];
        let mut padded = vec![0.0f32; w + 2 * reach];
        for (from, to) in self.values.chunks_exact(w).zip(rows.chunks_exact_mut(w)) {
            padded[..reach].fill(from[0]);
            padded[reach..reach + w].copy_from_slice(from);
            padded[reach + w..].fill(from[w - 1]);
            for x in 0..w {
                to[x] = kernel[0] * padded[reach + x];
            }
            for (i, k) in kernel.iter().enumerate().skip(1) {
                for x in 0..w {
                    to[x] += k * (padded[reach + x - i] + padded[reach + x + i]);
                }
            }
        }
        let mut values = vec![0.0f32; w * h];
        for y in 0..h {
            let to = &mut values[y * w..(y + 1) * w];
            for (x, value) in to.iter_mut().enumerate() {
                *value = kernel[0] * rows[y * w + x];
            }
            for (i, k) in kernel.iter().enumerate().skip(1) {
                let above = &rows[y.saturating_sub(i) * w..][..w];
                let below = &rows[(y + i).min(h - 1) * w..][..w];
                for x in 0..w {
                    to[x] += k * (above[x] + below[x]);
                }
            }
        }
        Self { width: w, height: h, values }
    }
}

/// Blobs of pixels with one value: their number for each pixel, from 1 on, 0 elsewhere, and how many pixels each has.
pub struct Blobs {
    pub numbers: Image<u32>,
    /// Element 0 is unused.
    pub sizes: Vec<usize>,
}

/// Connected pixels whose value is `of`; diagonal neighbours are connected if `diagonal`.
pub fn blobs(image: &Image<bool>, of: bool, diagonal: bool) -> Blobs {
    let (w, h) = (image.width, image.height);
    let mut numbers = Image::filled(w, h, 0u32);
    let mut sizes = vec![0];
    let mut open = Vec::new();
    for start in 0..w * h {
        if image.values[start] != of || numbers.values[start] != 0 {
            continue;
        }
        let number = sizes.len() as u32;
        let mut size = 0;
        numbers.values[start] = number;
        open.push(start);
        while let Some(k) = open.pop() {
            size += 1;
            for_neighbors(k, w, h, diagonal, |n| {
                if image.values[n] == of && numbers.values[n] == 0 {
                    numbers.values[n] = number;
                    open.push(n);
                }
            });
        }
        sizes.push(size);
    }
    Blobs { numbers, sizes }
}

/// Calls with the place of each neighbour of a pixel inside the image.
#[inline(always)]
pub fn for_neighbors(k: usize, w: usize, h: usize, diagonal: bool, mut call: impl FnMut(usize)) {
    let (x, y) = (k % w, k / w);
    let (left, right, up, down) = (x > 0, x + 1 < w, y > 0, y + 1 < h);
    if up {
        call(k - w);
    }
    if left {
        call(k - 1);
    }
    if right {
        call(k + 1);
    }
    if down {
        call(k + w);
    }
    if diagonal {
        if up && left {
            call(k - w - 1);
        }
        if up && right {
            call(k - w + 1);
        }
        if down && left {
            call(k + w - 1);
        }
        if down && right {
            call(k + w + 1);
        }
    }
}

/// Distance of each pixel that is `of` from the nearest pixel that is not, between pixel centres; 0 elsewhere.
///
/// Exact (Felzenszwalb and Huttenlocher, *Distance transforms of sampled functions*): columns, then the lower envelope of
/// parabolas along each run of a row. Distances above `most` may be found too great, but not below `most`.
pub fn distances(image: &Image<bool>, of: bool, most: usize) -> Image<f32> {
    let (w, h) = (image.width, image.height);
    let far = most.max(1) as u32 + 1;
    // distance along the column, at most `far`
    let mut along = vec![0u32; w * h];
    for y in 0..h {
        for x in 0..w {
            let k = y * w + x;
            if image.values[k] == of {
                along[k] = if y == 0 { far } else { (along[k - w] + 1).min(far) };
            }
        }
    }
    for y in (0..h.saturating_sub(1)).rev() {
        for x in 0..w {
            let k = y * w + x;
            along[k] = along[k].min(along[k + w] + 1);
        }
    }
    let mut found = Image::filled(w, h, 0.0f32);
    let (mut sites, mut starts) = (Vec::new(), Vec::new());
    for y in 0..h {
        let (from, to) = (&along[y * w..(y + 1) * w], &mut found.values[y * w..(y + 1) * w]);
        let mut x = 0;
        while x < w {
            if from[x] == 0 {
                x += 1;
                continue;
            }
            let begin = x;
            while x < w && from[x] > 0 {
                x += 1;
            }
            // pixels of other value beside the run stand for all beyond them
            envelope(from, begin.saturating_sub(1), (x + 1).min(w), &mut sites, &mut starts);
            let mut k = 0;
            for (x, value) in to.iter_mut().enumerate().take(x).skip(begin) {
                while k + 1 < sites.len() && starts[k + 1] <= x as f32 {
                    k += 1;
                }
                let away = x as f32 - sites[k] as f32;
                let down = from[sites[k]] as f32;
                *value = (away * away + down * down).sqrt();
            }
        }
    }
    found
}

/// The parabolas (x − i)² + g(i)² of the lower envelope over columns `begin` to `end`, and from where each is lowest.
fn envelope(g: &[u32], begin: usize, end: usize, sites: &mut Vec<usize>, starts: &mut Vec<f32>) {
    sites.clear();
    starts.clear();
    for i in begin..end {
        let high = |i: usize| (i * i) as f32 + (g[i] * g[i]) as f32;
        loop {
            let Some(&last) = sites.last() else {
                sites.push(i);
                starts.push(f32::NEG_INFINITY);
                break;
            };
            let meet = (high(i) - high(last)) / (2 * (i - last)) as f32;
            if meet <= *starts.last().unwrap_or(&f32::NEG_INFINITY) {
                sites.pop();
                starts.pop();
                continue;
            }
            sites.push(i);
            starts.push(meet);
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels that are drawn by lot, most of them set.
    fn drawn(width: usize, height: usize, seed: u64) -> Image<bool> {
        let mut state = seed;
        let mut image = Image::filled(width, height, true);
        for value in &mut image.values {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *value = state >> 33 & 31 != 0;
        }
        image
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        for seed in 1..6 {
            let image = drawn(37, 23, seed);
            for of in [true, false] {
                let found = distances(&image, of, 60);
                for k in 0..image.values.len() {
                    let (x, y) = (k % 37, k / 37);
                    let square = (0..image.values.len())
                        .filter(|&j| image.values[j] != of)
                        .map(|j| (j % 37).abs_diff(x).pow(2) + (j / 37).abs_diff(y).pow(2))
                        .min();
                    let expected = (square.unwrap() as f32).sqrt();
                    assert!((found.values[k] - expected).abs() < 1e-5, "{} for {expected}", found.values[k]);
                }
            }
        }
    }

    #[test]
    fn distances_above_the_most_are_not_found_below_it() {
        let mut image = Image::filled(50, 40, true);
        image.set(3, 4, false);
        let found = distances(&image, true, 10);
        for k in 0..image.values.len() {
            let expected = ((k % 50) as f32 - 3.0).hypot((k / 50) as f32 - 4.0);
            let right = (found.values[k] - expected).abs() < 1e-4;
            assert!(right || (expected > 10.0 && found.values[k] >= 10.0));
        }
    }

    #[test]
    fn blobs_are_numbered_and_counted() {
        let rows = ["##...", "..#..", "....#", "#...#"];
        let values: Vec<bool> = rows.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect();
        let image = Image { width: 5, height: 4, values };
        assert_eq!(blobs(&image, true, true).sizes[1..], [3, 2, 1]);
        assert_eq!(blobs(&image, true, false).sizes[1..], [2, 1, 2, 1]);
        let found = blobs(&image, true, true);
        assert_eq!(found.numbers.at(2, 1), found.numbers.at(0, 0));
        assert_eq!(found.numbers.at(1, 1), 0);
    }

    #[test]
    fn smoothing_keeps_the_sum_and_the_middle() {
        let mut image = Image::filled(41, 31, 0.0f32);
        image.set(20, 15, 1.0);
        let found = image.smoothed(2.0);
        let sum: f32 = found.values.iter().sum();
        assert!((sum - 1.0).abs() < 1e-5);
        assert!((found.at(18, 15) - found.at(22, 15)).abs() < 1e-7);
        assert!((found.at(20, 15) - 1.0 / (8.0 * std::f32::consts::PI)).abs() < 1e-3);
        assert!(
            (found.between(20.5, 15.0) - f64::from(found.at(20, 15) + found.at(21, 15)) / 2.0).abs() < 1e-7
        );
    }
}
