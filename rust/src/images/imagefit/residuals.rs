//! The spread of residuals, and their correlation along the ropes.

use super::curves::Curves;
use super::places::STEP;
use crate::geometry::median::{MEDIAN_TO_SD, measure_spread, upper_median};

const LAGS: usize = 16; // largest distance over which residuals are compared, samples
const MIN_CORRELATION: f64 = 0.1; // residuals with a smaller correlation count as independent
const OUTLIER: f64 = 4.0; // larger residuals do not count, standard deviations
const MIN_COUNT: usize = 20; // residuals at least

/// Errors about fitted curves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Their standard deviation, radii.
    pub sd: f64,
    /// Length of rope that counts as one observation, radii.
    pub length: f64,
}

/// Measures the spread of samples' depth residuals in some views, NaN where there is none; None if there are too few.
pub fn measure_depth_scatter<'a>(views: impl Iterator<Item = &'a [f64]>, curves: &Curves) -> Option<Scatter> {
    let views: Vec<&[f64]> = views.collect();
    let sizes: Vec<f64> = views.iter().copied().flatten().map(|e| e.abs()).filter(|e| !e.is_nan()).collect();
    if sizes.len() < MIN_COUNT {
        return None;
    }
    let limit = OUTLIER * MEDIAN_TO_SD * upper_median(&sizes)?;
    let mut sums = [(0.0, 0usize); LAGS + 1];
    for view in views.iter().filter(|view| !view.is_empty()) {
        for chain in &curves.chains {
            let errors = &view[chain.clone()];
            for (lag, (sum, count)) in sums.iter_mut().enumerate() {
                for (a, b) in errors.iter().zip(errors.iter().skip(lag)) {
                    if a.abs() <= limit && b.abs() <= limit {
                        *sum += a * b;
                        *count += 1;
                    }
                }
            }
        }
    }
    let mean = |(sum, count): (f64, usize)| sum / count.max(1) as f64;
    let power = mean(sums[0]);
    let correlations = sums[1..]
        .iter()
        .map(|&sum| mean(sum) / power)
        .take_while(|&correlation| correlation > MIN_CORRELATION);
    let length = STEP * (1.0 + 2.0 * correlations.sum::<f64>());
    (power > 0.0).then(|| Scatter { sd: power.sqrt(), length })
}

/// Measures the standard deviation of edges' residuals about their median; a mask that is too wide or too narrow errs
/// equally on both sides of a rope. None if there are too few residuals.
pub fn measure_edge_scatter<'a>(errors: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let errors: Vec<f64> = errors.copied().collect();
    if errors.len() < MIN_COUNT {
        return None;
    }
    measure_spread(errors).map(|(_, sd)| sd)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns normally distributed numbers from a linear congruential generator.
    fn normal(count: usize) -> Vec<f64> {
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
    }

    fn straight(samples: usize) -> Curves {
        let nodes = (0..samples).map(|k| [STEP * k as f64, 0.0, 0.0]).collect();
        Curves::through(&[nodes], 1.0)
    }

    #[test]
    fn errors_are_as_wide_and_as_long_as_they_were_made() {
        let curves = straight(4000);
        let count = curves.samples.len();
        let alone = normal(count + 4);
        // sums of five are correlated over five samples
        let mut long: Vec<f64> =
            alone.windows(5).map(|w| 0.2 * w.iter().sum::<f64>() / 5f64.sqrt()).collect();
        long.iter_mut().step_by(97).for_each(|e| *e = f64::NAN);
        long[1234] = 50.0;
        let found = measure_depth_scatter([long.as_slice()].into_iter(), &curves).unwrap();
        assert!((found.sd - 0.2).abs() < 0.02, "{found:?}");
        assert!((found.length - 5.0 * STEP).abs() < 0.5, "{found:?}");
        let alone: Vec<f64> = alone[..count].iter().map(|e| 0.3 * e).collect();
        // a view without residuals changes nothing
        let found = measure_depth_scatter([&[][..], &alone].into_iter(), &curves).unwrap();
        assert!((found.sd - 0.3).abs() < 0.03 && found.length < 2.0 * STEP, "{found:?}");
    }

    #[test]
    fn too_few_errors_say_nothing() {
        let curves = straight(100);
        let mut errors = vec![f64::NAN; curves.samples.len()];
        errors[..MIN_COUNT - 1].fill(0.1);
        assert_eq!(measure_depth_scatter([errors.as_slice()].into_iter(), &curves), None);
        assert_eq!(
            measure_depth_scatter([vec![0.0; curves.samples.len()].as_slice()].into_iter(), &curves),
            None
        );
        assert_eq!(measure_edge_scatter([0.1; MIN_COUNT - 1].iter()), None);
    }

    #[test]
    fn a_mask_that_is_grown_is_no_error_of_its_edge() {
        let grown: Vec<f64> = normal(4000).into_iter().map(|e| 0.7 + 0.25 * e).collect();
        let found = measure_edge_scatter(grown.iter()).unwrap();
        assert!((found - 0.25).abs() < 0.03, "{found}");
    }
}
