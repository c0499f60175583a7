//! Colours of a screen (sRGB, white D65) to Lab, in which distances are as large as they look.

use super::Planes;
use crate::images::image::Image;
use crate::parallel;

const TO_XYZ: [[f32; 3]; 3] = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]; // rows: X, Y, Z of linear light
const WHITE: [f32; 3] = [0.9505, 1.0, 1.089]; // X, Y, Z of white
const CELLS: usize = 4096; // cells of the table of cube roots

/// Converts colours, red, green and blue of each pixel in turn.
pub fn convert_to_lab(colors: &[u8], width: usize) -> Planes {
    let height = colors.len() / (3 * width.max(1));
    let linear: Vec<f32> = (0..256).map(|level| linear_light(f64::from(level) / 255.0) as f32).collect();
    let roots: Vec<f32> = (0..=CELLS + 1).map(|cell| root(cell as f64 / CELLS as f64) as f32).collect();
    let find_root = |x: f32| {
        let place = (x * CELLS as f32).clamp(0.0, CELLS as f32);
        let cell = place as usize;
        roots[cell] + (roots[cell + 1] - roots[cell]) * (place - cell as f32)
    };
    let mut found = vec![[0.0f32; 3]; width * height];
    parallel::rows(&mut found, width, |first, part| {
        let own = &colors[3 * first * width..];
        for (to, rgb) in part.iter_mut().zip(own.chunks_exact(3)) {
            let light = [linear[rgb[0] as usize], linear[rgb[1] as usize], linear[rgb[2] as usize]];
            let mut roots = [0.0; 3];
            for k in 0..3 {
                let row = TO_XYZ[k];
                roots[k] = find_root((row[0] * light[0] + row[1] * light[1] + row[2] * light[2]) / WHITE[k]);
            }
            let [x, y, z] = roots;
            *to = [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)];
        }
    });
    [0, 1, 2].map(|k| Image { width, height, values: found.iter().map(|color| color[k]).collect() })
}

/// Returns the light of a level of sRGB, both from 0 to 1.
fn linear_light(level: f64) -> f64 {
    if level <= 0.04045 { level / 12.92 } else { ((level + 0.055) / 1.055).powf(2.4) }
}

/// Returns the cube root, continued by a line near black.
fn root(x: f64) -> f64 {
    if x > 0.008856 { x.cbrt() } else { 7.787 * x + 16.0 / 116.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_colors_have_known_places() {
        let colors = [255, 255, 255, 0, 0, 0, 255, 0, 0, 0, 0, 255, 119, 119, 119];
        let found = convert_to_lab(&colors, 5);
        let known =
            [[100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [53.2, 80.1, 67.2], [32.3, 79.2, -107.9], [50.0, 0.0, 0.0]];
        for (k, known) in known.iter().enumerate() {
            for (plane, value) in found.iter().zip(known) {
                assert!((plane.values[k] - value).abs() < 0.4, "{k} {} {value}", plane.values[k]);
            }
        }
    }
}
