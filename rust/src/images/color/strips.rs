//! Strips: places whose colour differs from both sides, over widths and directions.
//!
//! At each width, the image is made so small that a strip is 3 to 5 pixels wide. Let c be the mean colour along a short
//! line, and a and b those of the lines 4 pixels aside. The response is the least of |c − a|, |c − b| and
//! (|c − a| + |c − b| − |a − b|) / 2, less a share of |a − b|. The third term is zero at a blurred edge between two
//! things, because c lies between a and b there.

use super::levels::{find_places, interpolate, shrunk, shrunk_planes};
use super::{Planes, median, size};
use crate::images::image::Image;
use crate::parallel;
use crate::simd::kernel;

const DIRECTIONS: usize = 8; // directions of half a turn
const ALONG: f64 = 2.0; // pixels from the middle of a line to its ends
const ASIDE: f64 = 4.0; // pixels from a strip's middle to the lines beside it
const MARGIN: usize = 8; // pixels around an image, with the colours of its border
const STEP: f64 = 1.5; // from one width to the next
const HALF_WIDTH: f64 = 2.0; // pixels of a small image: half width of the strips that answer most
const MAX_WIDTH: f64 = 4.5; // pixels of a small image: largest width of a strip there
const TOGETHER: usize = 16; // pixels that are compared at once
const BLOCK: usize = 24; // pixels: side of the blocks whose median response is the background's
const EACH: usize = 2; // every second row and column of a block counts
const BLOCKS: usize = 2; // blocks on each side of one whose median counts
const WEAKEST: f32 = 0.4; // least response that is kept
const BETTER: f32 = 1.1; // the response at another width has to be larger by this

/// What counts as a strip.
#[derive(Debug, Clone, Copy)]
pub struct StripOptions {
    /// Largest width, pixels.
    pub max_width: f64,
    /// Least response.
    pub min_contrast: f32,
    /// Least response, in median responses of the surroundings.
    pub noise: f32,
    /// Share of the difference of both sides that is taken off.
    pub aside: f32,
    /// Whether the first plane has to be larger than on both sides, and no other plane counts.
    pub signed: bool,
}

/// The strongest strip at each pixel.
pub struct Strips {
    /// The response over the least one.
    pub response: Image<f32>,
    /// Half width, pixels.
    pub half_width: Image<f32>,
    /// How much both sides differ, over the difference from them.
    pub aside: Image<f32>,
}

/// Finds the strongest strip at each pixel. Responses below `WEAKEST` are 0.
pub fn find_strips(planes: &Planes, options: &StripOptions) -> Strips {
    let [width, height] = size(planes);
    let mut best: Vec<[f32; 3]> = vec![[0.0, 1.0, 0.0]; width * height];
    let mut levels: Vec<Planes> = Vec::new();
    let mut scale = 1.0;
    while scale == 1.0 || MAX_WIDTH * scale <= options.max_width {
        let small = [width, height].map(|side| ((side as f64 / scale).round() as usize).max(1));
        // smaller copies of smaller copies are as good, and cheaper
        let from = if levels.len() >= 2 { &levels[levels.len() - 2] } else { planes };
        let level = shrunk_planes(from, small);
        let (response, aside) = find_responses(&level, options);
        levels.push(level);
        let half_width = (HALF_WIDTH * scale) as f32;
        keep_better(&mut best, [width, height], &response, &aside, half_width);
        scale *= STEP;
    }
    let [response, half_width, aside] =
        [0, 1, 2].map(|k| Image { width, height, values: best.iter().map(|found| found[k]).collect() });
    Strips { response, half_width, aside }
}

/// Keeps the responses of a small image where they are better than those that were found.
fn keep_better(
    best: &mut [[f32; 3]],
    [width, height]: [usize; 2],
    response: &Image<f32>,
    aside: &Image<f32>,
    half_width: f32,
) {
    let columns = find_places(width, response.width);
    let rows = find_places(height, response.height);
    // the columns that lie between the same two of the small image
    let mut runs: Vec<(usize, usize, usize)> = Vec::new();
    for (x, &(i, _)) in columns.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if run.0 == i => run.2 = x + 1,
            _ => runs.push((i, x, x + 1)),
        }
    }
    let same = [width, height] == [response.width, response.height];
    parallel::rows(best, width, |first, part| {
        for (n, row) in part.chunks_exact_mut(width).enumerate() {
            if same {
                let own = (first + n) * width..(first + n + 1) * width;
                let pairs = response.values[own.clone()].iter().zip(&aside.values[own]);
                for (to, (&answer, &aside)) in row.iter_mut().zip(pairs) {
                    if answer > WEAKEST.max(BETTER * to[0]) {
                        *to = [answer, half_width, aside];
                    }
                }
                continue;
            }
            let y = rows[first + n];
            let upper = &response.values[y.0 * response.width..][..response.width];
            let lower = if y.0 + 1 < response.height {
                &response.values[(y.0 + 1) * response.width..][..response.width]
            } else {
                upper
            };
            for &(i, begin, end) in &runs {
                let next = (i + 1).min(response.width - 1);
                if upper[i].max(upper[next]).max(lower[i]).max(lower[next]) < WEAKEST {
                    continue;
                }
                for (to, &x) in row[begin..end].iter_mut().zip(&columns[begin..end]) {
                    let answer = interpolate(response, x, y);
                    if answer > BETTER * to[0] {
                        *to = [answer, half_width, interpolate(aside, x, y)];
                    }
                }
            }
        }
    });
}

/// Returns the largest response over directions, over the least one there, and how much the sides differ.
fn find_responses(level: &Planes, options: &StripOptions) -> (Image<f32>, Image<f32>) {
    let [width, height] = size(level);
    let padded = [0, 1, 2].map(|k| padded(&level[k]));
    let mut found = vec![[0.0f32; 2]; width * height];
    parallel::rows(&mut found, width, |first, part| respond(&padded, options, first, width, part));
    let mut response = Image { width, height, values: found.iter().map(|f| f[0]).collect() };
    let aside = Image { width, height, values: found.iter().map(|f| f[1]).collect() };
    let usual = find_usual(&response);
    let (columns, rows) = (find_places(width, usual.width), find_places(height, usual.height));
    // along rows first, once for each row of blocks
    let along: Vec<f32> = (0..usual.height)
        .flat_map(|j| columns.iter().map(move |&x| (j, x)))
        .map(|(j, x)| interpolate(&usual, x, (j, 0.0)))
        .collect();
    parallel::rows(&mut response.values, width, |first, part| {
        for (n, row) in part.chunks_exact_mut(width).enumerate() {
            let (j, weight) = rows[first + n];
            let upper = &along[j * width..][..width];
            let lower = &along[(j + 1).min(usual.height - 1) * width..][..width];
            for ((value, a), b) in row.iter_mut().zip(upper).zip(lower) {
                let least = options.noise * (a * (1.0 - weight) + b * weight);
                *value /= least.max(options.min_contrast);
            }
        }
    });
    (response, aside)
}

/// Returns an image with a margin that repeats its border.
fn padded(image: &Image<f32>) -> Image<f32> {
    let (width, height) = (image.width + 2 * MARGIN, image.height + 2 * MARGIN);
    let mut values = Vec::with_capacity(width * height);
    for y in 0..height {
        let row = y.saturating_sub(MARGIN).min(image.height - 1) * image.width;
        let row = &image.values[row..row + image.width];
        values.resize(values.len() + MARGIN, row[0]);
        values.extend_from_slice(row);
        values.resize(values.len() + MARGIN, row[image.width - 1]);
    }
    Image { width, height, values }
}

kernel! {
    /// Finds responses of rows, from row `first` on: the largest one over directions, and how much the sides differ.
    fn respond<S>(
        _, planes: &Planes, options: &StripOptions, first: usize, width: usize, to: &mut [[f32; 2]],
    ) {
        let (wide, reach) = (planes[0].width, ASIDE as usize);
        let rows = to.len() / width;
        let used = if options.signed { 1 } else { 3 };
        // means along lines, of these rows and of those beside them
        let mut means = vec![vec![0.0f32; (rows + 2 * reach) * wide]; used];
        let (mut best, mut sides) = (vec![0.0f32; to.len()], vec![0.0f32; to.len()]);
        for direction in 0..DIRECTIONS {
            let (sine, cosine) = (std::f64::consts::PI * direction as f64 / DIRECTIONS as f64).sin_cos();
            let round = |x: f64| x.round() as isize;
            let along = round(ALONG * sine) * wide as isize + round(ALONG * cosine);
            let aside = round(ASIDE * cosine) * wide as isize + round(-ASIDE * sine);
            for (mean, plane) in means.iter_mut().zip(planes) {
                for (n, row) in mean.chunks_exact_mut(wide).enumerate() {
                    let start = (first + n + MARGIN - reach) * wide + 2;
                    let (own, count) = (&plane.values[start..], wide - 4);
                    let before = &plane.values[(start as isize + along) as usize..][..count];
                    let after = &plane.values[(start as isize - along) as usize..][..count];
                    for (((to, a), b), c) in row[2..][..count].iter_mut().zip(own).zip(before).zip(after) {
                        *to = (a + b + c) / 3.0;
                    }
                }
            }
            for row in 0..rows {
                let start = (row + reach) * wide + MARGIN;
                let at = |k: usize, shift: isize| &means[k][(start as isize + shift) as usize..][..width];
                let best = &mut best[row * width..][..width];
                let sides = &mut sides[row * width..][..width];
                if options.signed {
                    let (own, a, b) = (at(0, 0), at(0, aside), at(0, -aside));
                    for x in 0..width {
                        best[x] = best[x].max(own[x] - a[x].max(b[x]));
                    }
                    continue;
                }
                let own = [at(0, 0), at(1, 0), at(2, 0)];
                let before = [at(0, aside), at(1, aside), at(2, aside)];
                let after = [at(0, -aside), at(1, -aside), at(2, -aside)];
                compare(own, before, after, options.aside, best, sides);
            }
        }
        for ((to, best), side) in to.iter_mut().zip(best).zip(sides) {
            *to = [best, side];
        }
    }
}

/// Updates the largest response of a row, and how much the sides differ there.
#[inline(always)]
fn compare(
    own: [&[f32]; 3],
    before: [&[f32]; 3],
    after: [&[f32]; 3],
    weight: f32,
    best: &mut [f32],
    sides: &mut [f32],
) {
    let width = best.len();
    if width < TOGETHER {
        for x in 0..width {
            compare_some::<1>(own, before, after, weight, best, sides, x);
        }
        return;
    }
    // the last ones may come twice, which changes nothing
    let mut x = 0;
    while x + TOGETHER < width {
        compare_some::<TOGETHER>(own, before, after, weight, best, sides, x);
        x += TOGETHER;
    }
    compare_some::<TOGETHER>(own, before, after, weight, best, sides, width - TOGETHER);
}

/// Does [`compare`] for `N` pixels from `x` on.
#[inline(always)]
fn compare_some<const N: usize>(
    own: [&[f32]; 3],
    before: [&[f32]; 3],
    after: [&[f32]; 3],
    weight: f32,
    best: &mut [f32],
    sides: &mut [f32],
    x: usize,
) {
    let (mut ca, mut cb, mut ab) = ([0.0f32; N], [0.0f32; N], [0.0f32; N]);
    for k in 0..3 {
        let (c, a, b) = (&own[k][x..x + N], &before[k][x..x + N], &after[k][x..x + N]);
        for n in 0..N {
            let (u, v, w) = (c[n] - a[n], c[n] - b[n], a[n] - b[n]);
            ca[n] += u * u;
            cb[n] += v * v;
            ab[n] += w * w;
        }
    }
    let (best, sides) = (&mut best[x..x + N], &mut sides[x..x + N]);
    for n in 0..N {
        let (ca, cb, ab) = (ca[n].sqrt(), cb[n].sqrt(), ab[n].sqrt());
        let least = if ca < cb { ca } else { cb };
        let between = 0.5 * (ca + cb - ab);
        let answer = (if least < between { least } else { between }) - weight * ab;
        let better = answer > best[n];
        best[n] = if better { answer } else { best[n] };
        sides[n] = if better { ab / (least + 1e-3) } else { sides[n] };
    }
}

/// Returns medians of blocks, and of these the median around each block.
fn find_usual(response: &Image<f32>) -> Image<f32> {
    let (w, h) = (response.width, response.height);
    let (columns, rows) = ((w / BLOCK).max(1), (h / BLOCK).max(1));
    let places: Vec<[usize; 2]> = (0..rows * columns).map(|k| [k % columns, k / columns]).collect();
    let medians = parallel::map(&places, |&[i, j]| {
        let mut own = Vec::new();
        for y in (j * h / rows..(j + 1) * h / rows).step_by(EACH) {
            let row = &response.values[y * w + i * w / columns..y * w + (i + 1) * w / columns];
            own.extend(row.iter().step_by(EACH));
        }
        median(&mut own)
    });
    let near = |k: usize, count: usize| k.saturating_sub(BLOCKS)..(k + BLOCKS + 1).min(count);
    let values = places
        .iter()
        .map(|&[i, j]| {
            let around = near(j, rows).flat_map(|y| near(i, columns).map(move |x| y * columns + x));
            median(&mut around.map(|k| medians[k]).collect::<Vec<f32>>())
        })
        .collect();
    shrunk(&Image { width: columns, height: rows, values }, [columns, rows])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(color: impl Fn(f64, f64) -> [f32; 3]) -> Planes {
        [0, 1, 2].map(|k| Image {
            width: 120,
            height: 90,
            values: (0..120 * 90).map(|p| color((p % 120) as f64, (p / 120) as f64)[k]).collect(),
        })
    }

    fn options() -> StripOptions {
        StripOptions { max_width: 20.0, min_contrast: 7.0, noise: 4.0, aside: 0.3, signed: false }
    }

    #[test]
    fn a_strip_answers_with_its_width_and_an_edge_does_not() {
        for half in [2.0, 4.5] {
            let strip = |x: f64, y: f64| (x - y / 3.0 - 40.0).abs() < half * 1.05;
            let planes = drawn(|x, y| if strip(x, y) { [60.0, 20.0, 0.0] } else { [30.0, 0.0, 0.0] });
            let found = find_strips(&planes, &options());
            let middle = 45 * 120 + 55;
            assert!(found.response.values[middle] > 2.0);
            assert!(f64::from(found.half_width.values[middle] / half as f32).ln().abs() < 0.5);
            assert!(found.response.values[45 * 120 + 100] < 0.1);
        }
        let edge = drawn(|x, _| [30.0 + 40.0 * ((x - 57.0) / 6.0).clamp(0.0, 1.0) as f32, 0.0, 0.0]);
        let found = find_strips(&edge, &options());
        assert!(found.response.values.iter().all(|&response| response < 0.2));
    }

    #[test]
    fn responses_are_those_of_brute_force() {
        let planes = drawn(|x, y| {
            let k = (x * 7.0 + y * 13.0) as usize;
            [(k % 31) as f32, (k % 17) as f32, (k % 5) as f32]
        });
        let padded = [0, 1, 2].map(|k| padded(&planes[k]));
        let mut found = vec![[0.0f32; 2]; 120 * 90];
        respond(&padded, &options(), 0, 120, &mut found);
        let at = |x: isize, y: isize| {
            let k = (y.clamp(0, 89) * 120 + x.clamp(0, 119)) as usize;
            [0, 1, 2].map(|p| planes[p].values[k])
        };
        for (x, y) in [(40isize, 30isize), (0, 0), (119, 50), (77, 89)] {
            let mut best = 0.0f32;
            for direction in 0..DIRECTIONS {
                let (s, c) = (std::f64::consts::PI * direction as f64 / 8.0).sin_cos();
                let (dx, dy) = ((2.0 * c).round() as isize, (2.0 * s).round() as isize);
                let (nx, ny) = ((-4.0 * s).round() as isize, (4.0 * c).round() as isize);
                let line = |x: isize, y: isize| {
                    let (a, b, c) = (at(x, y), at(x + dx, y + dy), at(x - dx, y - dy));
                    [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0)
                };
                let apart = |a: [f32; 3], b: [f32; 3]| crate::images::color::difference2(a, b).sqrt();
                let (c, a, b) = (line(x, y), line(x + nx, y + ny), line(x - nx, y - ny));
                let (ca, cb, ab) = (apart(c, a), apart(c, b), apart(a, b));
                best = best.max(ca.min(cb).min(0.5 * (ca + cb - ab)) - 0.3 * ab);
            }
            assert!((found[(y * 120 + x) as usize][0] - best).abs() < 1e-4);
        }
    }
}
