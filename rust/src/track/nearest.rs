//! The sample nearest to a pixel, found by the cells of the image.

use crate::geometry::Point;

const CELL: f64 = 10.0; // pixels: side of a cell
/// A distance in the image is at least this share of that in space.
const LEAST_SHARE: f64 = 0.8;

/// Samples of ropes by the cells of an image.
pub struct Nearest<'a> {
    places: &'a [Point],
    columns: i64,
    rows: i64,
    /// First entry of each cell in `members`, and the end of the last.
    starts: Vec<u32>,
    members: Vec<u32>,
    /// Metres at a distance of one metre that a pixel spans.
    pixel: f64,
}

impl<'a> Nearest<'a> {
    /// Sorts places of the camera's frame by the pixels that show them.
    pub fn new(places: &'a [Point], pixels: &[[f64; 2]], width: usize, height: usize, pixel: f64) -> Self {
        let (columns, rows) = (width as i64 / CELL as i64 + 1, height as i64 / CELL as i64 + 1);
        // places outside the image belong to the cells at its border
        let cell_of = |[u, v]: [f64; 2]| {
            let (column, row) = ((u / CELL) as i64, (v / CELL) as i64);
            (row.clamp(0, rows - 1) * columns + column.clamp(0, columns - 1)) as usize
        };
        let mut starts = vec![0u32; (columns * rows) as usize + 1];
        for &place in pixels {
            starts[cell_of(place) + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut members = vec![0; pixels.len()];
        for (i, &place) in pixels.iter().enumerate() {
            let cell = cell_of(place);
            members[next[cell] as usize] = i as u32;
            next[cell] += 1;
        }
        Self { places, columns, rows, starts, members, pixel }
    }

    /// Returns the place nearest to `p`, which the pixel (u, v) shows, and its distance, metres, if it is below `gate`.
    /// Differences of depth count `deep` times. Places may be pixels too, at a depth of 0, for a `p` at a depth of 1.
    pub fn find(&self, p: Point, [u, v]: [f64; 2], gate: f64, deep: f64) -> Option<(usize, f64)> {
        let (column, row) = ((u / CELL) as i64, (v / CELL) as i64);
        let size = CELL * self.pixel * p[2] * LEAST_SHARE;
        let mut best = (usize::MAX, gate * gate);
        let farthest = self.columns.max(self.rows);
        for ring in 0..=farthest {
            // the nearest edge of this ring is ring − 1 cells away
            let least = (ring - 1).max(0) as f64 * size;
            if least * least >= best.1 {
                break;
            }
            for r in row - ring..=row + ring {
                if r < 0 || r >= self.rows {
                    continue;
                }
                let step = if (r - row).abs() == ring { 1 } else { 2 * ring };
                for c in (column - ring..=column + ring).step_by(step.max(1) as usize) {
                    if c < 0 || c >= self.columns {
                        continue;
                    }
                    let cell = (r * self.columns + c) as usize;
                    for &i in &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize] {
                        let q = self.places[i as usize];
                        let (x, y, z) = (p[0] - q[0], p[1] - q[1], deep * (p[2] - q[2]));
                        let squared = x * x + y * y + z * z;
                        if squared < best.1 {
                            best = (i as usize, squared);
                        }
                    }
                }
            }
        }
        (best.0 != usize::MAX).then(|| (best.0, best.1.sqrt()))
    }
}
