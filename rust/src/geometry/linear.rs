//! Linear functions of places in a plane.

use nalgebra::{Matrix3, Vector3};

use super::median::{MEDIAN_TO_SD, median};

const ROUNDS: usize = 10; // rounds of the robust fit
const HALF_WEIGHT: f64 = 2.0; // a value counts half at this distance, standard deviations
const SETTLED_CHANGE: f64 = 0.01; // relative change of the scatter between rounds at which the fit ends

/// Returns the robust standard deviation of values about the linear function of their places that fits best. Differences
/// are multiplied by scales first, and outliers count little. It is infinite if the places lie on a line.
pub fn measure_linear_scatter(places: &[[f64; 2]], values: &[f64], scales: &[f64]) -> f64 {
    let (mut weights, mut scatter) = (vec![1.0; places.len()], f64::INFINITY);
    let terms = |[x, y]: [f64; 2]| Vector3::new(1.0, x, y);
    for _ in 0..ROUNDS {
        let (mut products, mut sums) = (Matrix3::zeros(), Vector3::zeros());
        for ((&place, &value), &weight) in places.iter().zip(values).zip(&weights) {
            let weighted = weight * terms(place);
            products += weighted * terms(place).transpose();
            sums += value * weighted;
        }
        let Some(linear) = products.lu().solve(&sums) else { return f64::INFINITY };
        let off = places.iter().zip(values).zip(scales);
        let off: Vec<f64> =
            off.map(|((&place, value), scale)| (value - terms(place).dot(&linear)) * scale).collect();
        let before = scatter;
        scatter = MEDIAN_TO_SD * median(off.iter().map(|off| off.abs()).collect()).unwrap_or(0.0);
        if (scatter - before).abs() < SETTLED_CHANGE * scatter {
            break;
        }
        let half = (HALF_WEIGHT * scatter).max(f64::MIN_POSITIVE);
        for (weight, off) in weights.iter_mut().zip(off) {
            *weight = 1.0 / (1.0 + (off / half).powi(2));
        }
    }
    scatter
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_is_that_of_most_values_whatever_a_few_are() {
        let places: Vec<[f64; 2]> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20)]).collect();
        // half of the errors have each sign, and a tenth of the values are far away
        let error =
            |i: usize| if i % 10 == 7 { 90.0 } else { 0.1 * f64::from(i as u32 * 7919 % 200) / 100.0 - 0.1 };
        let values: Vec<f64> =
            places.iter().enumerate().map(|(i, [x, y])| 3.0 - 0.5 * x + 2.0 * y + error(i)).collect();
        let found = measure_linear_scatter(&places, &values, &vec![2.0; 400]);
        // the median size of the errors is about 0.05
        assert!((found / (2.0 * MEDIAN_TO_SD * 0.055) - 1.0).abs() < 0.15, "{found}");
        let line: Vec<[f64; 2]> = places.iter().map(|_| [0.0, 0.0]).collect();
        assert_eq!(measure_linear_scatter(&line, &values, &vec![1.0; 400]), f64::INFINITY);
    }
}
