//! Windows of a depth image that show planes, and how depths differ from these.

use crate::clouds::depth::has_return;
use crate::geometry::median::{MEDIAN_TO_SD, median};
use crate::parallel;
use crate::simd::kernel;

const SIDE: usize = 40; // side of the windows that planes are fitted to, pixels
pub const PIXELS: usize = SIDE * SIDE; // pixels of a window
const MAX_WINDOWS: usize = 40; // windows that planes are fitted to
const MAX_USED: usize = 8; // windows that are used
const MAX_MISSING: f64 = 0.05; // share of a window's pixels that may have no depth
const FILLINGS: usize = 3; // fits after which these are on the plane of the others
const MAX_ERROR: f64 = 6.0; // a window with a larger residual shows no plane, standard deviations
const NARROW_SHARE: f64 = 0.25; // quantile of the windows' standard deviations that a plane is expected to have
const MAX_WIDTH: f64 = 1.5; // times that quantile: wider residuals are those of no plane

/// A number of each pixel of a window, row by row.
type Window = [[f64; SIDE]; SIDE];

/// The residuals of a window's depths.
struct Residuals {
    /// Of 1 / z.
    errors: Box<Window>,
    /// Their standard deviation, and that of depth, metres.
    sd: f64,
    wide: f64,
    /// The window's mean depth, metres.
    depth: f64,
}

/// Returns residuals of windows that show a plane, in standard deviations, row by row.
///
/// On a plane, 1 / z is linear in the pixel's column and row. A plane is fitted to each of some windows. Those whose depth
/// is nearest to `near` are used.
pub fn measure_plane_errors(depth: &[f64], width: usize, near: f64) -> Vec<f64> {
    let row = |corner: usize, y: usize| &depth[corner + y * width..][..SIDE];
    let most = MAX_MISSING * PIXELS as f64;
    let mut full = Vec::new();
    for (band, rows) in depth.chunks_exact((SIDE * width).max(1)).enumerate() {
        let mut missing = vec![0; width];
        count_missing(rows, &mut missing);
        let corners = (0..).step_by(SIDE).map(|column| band * SIDE * width + column);
        let counts = missing.chunks_exact(SIDE).map(|columns| columns.iter().sum::<u64>() as f64);
        full.extend(corners.zip(counts).filter(|&(_, count)| count < most).map(|(corner, _)| corner));
    }
    let every = full.len().div_ceil(MAX_WINDOWS).max(1);
    let some: Vec<usize> = full.into_iter().step_by(every).collect();
    let mut windows = parallel::map(&some, |&corner| fit_window(|y| row(corner, y)));
    let mut wide: Vec<f64> = windows.iter().map(|window| window.wide).collect();
    wide.sort_unstable_by(f64::total_cmp);
    let Some(last) = wide.len().checked_sub(1) else { return Vec::new() };
    let rank = NARROW_SHARE * last as f64;
    let (below, above) = (wide[rank as usize], wide[(rank as usize + 1).min(last)]);
    let expected = below + (above - below) * rank.fract();
    windows.sort_by(|a, b| (a.depth - near).abs().total_cmp(&(b.depth - near).abs()));
    windows.retain(|window| {
        let largest = window.errors.as_flattened().iter().fold(0.0f64, |most, error| most.max(error.abs()));
        largest < MAX_ERROR * window.sd && window.sd > 0.0 && window.wide < MAX_WIDTH * expected
    });
    windows.truncate(MAX_USED);
    windows.iter().flat_map(|w| w.errors.as_flattened().iter().map(|error| error / w.sd)).collect()
}

kernel! {
    /// Counts the pixels without depth in each column of some rows.
    fn count_missing<S>(_, rows: &[f64], counts: &mut [u64]) {
        for row in rows.chunks_exact(counts.len().max(1)) {
            for (count, &z) in counts.iter_mut().zip(row) {
                *count += u64::from(!has_return(z));
            }
        }
    }
}

kernel! {
    /// Takes the inverses of a row's depths, 0 where there is none, and adds the depths to the sums of their columns.
    fn invert<S>(_, row: &[f64], to: &mut [f64; SIDE], sums: &mut [f64; SIDE]) {
        for ((to, sum), &z) in to.iter_mut().zip(sums).zip(row) {
            let shown = has_return(z);
            *to = if shown { 1.0 / z } else { 0.0 };
            *sum += if shown { z } else { 0.0 };
        }
    }
}

/// Fits a plane to a window, given by row. Single pixels without depth are on the plane of the others.
fn fit_window<'a>(row: impl Fn(usize) -> &'a [f64]) -> Residuals {
    let mut errors: Box<Window> = Box::new([[0.0; SIDE]; SIDE]);
    let mut sums = [0.0; SIDE];
    for (y, to) in errors.iter_mut().enumerate() {
        invert(row(y), to, &mut sums);
    }
    let mut sum = sums.iter().sum::<f64>();
    let bare: Vec<[usize; 2]> = (errors.iter().enumerate())
        .filter(|(_, row)| row.contains(&0.0))
        .flat_map(|(y, row)| (0..SIDE).filter(|&x| row[x] == 0.0).map(move |x| [x, y]))
        .collect();
    for _ in 0..if bare.is_empty() { 0 } else { FILLINGS } {
        let plane = fit_plane(&errors);
        for &[x, y] in &bare {
            errors[y][x] = plane[0] + plane[1] * AXIS[x] + plane[2] * AXIS[y];
        }
    }
    sum += bare.iter().map(|&[x, y]| 1.0 / errors[y][x]).sum::<f64>();
    let plane = fit_plane(&errors);
    subtract(plane, &mut errors);
    let sizes = errors.as_flattened().iter().map(|error| error.abs()).collect();
    let (sd, depth) = (MEDIAN_TO_SD * median(sizes).unwrap_or(0.0), sum / PIXELS as f64);
    Residuals { errors, sd, wide: sd * depth * depth, depth }
}

/// The columns or rows of a window, in its sides from its middle.
const AXIS: [f64; SIDE] = {
    let mut axis = [0.0; SIDE];
    let mut k = 0;
    while k < SIDE {
        axis[k] = (k as f64 - 0.5 * (SIDE - 1) as f64) / SIDE as f64;
        k += 1;
    }
    axis
};

kernel! {
    /// Fits a linear function to a window: its mean, and its growth along columns and rows, in the window's sides.
    fn fit_plane<S>(_, values: &Window) -> [f64; 3] {
        let (mut sums, mut moments) = ([0.0; SIDE], [0.0; SIDE]);
        for (row, down) in values.iter().zip(AXIS) {
            for ((sum, moment), value) in sums.iter_mut().zip(&mut moments).zip(row) {
                *sum += value;
                *moment += down * value;
            }
        }
        let square = SIDE as f64 * AXIS.iter().map(|x| x * x).sum::<f64>();
        let across = sums.iter().zip(AXIS).map(|(sum, x)| sum * x).sum::<f64>();
        [sums.iter().sum::<f64>() / PIXELS as f64, across / square, moments.iter().sum::<f64>() / square]
    }
}

kernel! {
    /// Subtracts a linear function from a window.
    fn subtract<S>(_, plane: [f64; 3], values: &mut Window) {
        for (row, down) in values.iter_mut().zip(AXIS) {
            let middle = plane[0] + plane[2] * down;
            for (value, across) in row.iter_mut().zip(AXIS) {
                *value -= middle + plane[1] * across;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 130;

    /// Returns depths of a slope with errors, metres, about `sd`.
    fn drawn(sd: f64) -> Vec<f64> {
        let mut state = 5u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let nearness = |x: usize, y: usize| 1.6 + 1e-3 * x as f64 - 2e-3 * y as f64;
        (0..WIDTH * 90).map(|k| 1.0 / nearness(k % WIDTH, k / WIDTH) + sd * 12f64.sqrt() * next()).collect()
    }

    #[test]
    fn residuals_of_planes_have_unit_width_and_the_nearest_windows_come_first() {
        let depth = drawn(1e-3);
        let found = measure_plane_errors(&depth, WIDTH, 0.6);
        assert_eq!(found.len(), 6 * PIXELS);
        for window in found.chunks_exact(PIXELS) {
            let power = window.iter().map(|error| error * error).sum::<f64>() / PIXELS as f64;
            // the median of even errors is 3 / 4 of that of normal ones
            assert!((0.4..0.8).contains(&power), "{power}");
        }
        // the window in the corner that lies nearest has the least depth
        let first = measure_plane_errors(&depth, WIDTH, 0.0);
        assert_eq!(first[..PIXELS], measure_plane_errors(&depth[80..], WIDTH, 0.0)[..PIXELS]);
    }

    #[test]
    fn single_pixels_may_lack_depth_and_other_things_show_no_plane() {
        let mut depth = drawn(1e-3);
        for k in (0..depth.len()).step_by(50) {
            depth[k] = if k % 100 == 0 { 0.0 } else { f64::INFINITY };
        }
        assert_eq!(measure_plane_errors(&depth, WIDTH, 0.6).len(), 6 * PIXELS);
        // a step
        depth[..20 * WIDTH].iter_mut().for_each(|z| *z += 0.1);
        assert_eq!(measure_plane_errors(&depth, WIDTH, 0.6).len(), 3 * PIXELS);
        depth.iter_mut().step_by(15).for_each(|z| *z = f64::NAN);
        assert!(measure_plane_errors(&depth, WIDTH, 0.6).is_empty());
        assert!(measure_plane_errors(&[], 0, 0.6).is_empty());
        assert!(measure_plane_errors(&depth[..39 * 39], 39, 0.6).is_empty());
    }
}
