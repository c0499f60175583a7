//! A grid of places in an image, for searches of near places.

use super::places::Place2;
use crate::geometry::cut_off;

const CELLS: f64 = 16.0; // cells for each place, about
const NARROW: f64 = 0.51; // side of a cell at least, reaches

/// Places sorted into square cells.
#[derive(Debug, Default)]
pub struct Grid {
    origin: Place2,
    inverse: f64,
    size: [usize; 2],
    /// The first place of each cell.
    starts: Vec<u32>,
    /// Numbers and places, cell by cell, in the order of their numbers.
    items: Vec<(u32, Place2)>,
    cells: Vec<u32>,
}

impl Grid {
    /// Sorts places into the cells of a frame, given by its corner and size. Places outside belong to the border's
    /// cells. Cells are as wide as the `reach` of searches, or narrower where there are many places.
    pub fn fill(&mut self, places: &[Place2], frame: (Place2, [usize; 2]), reach: f64) {
        let area = frame.1.iter().map(|&n| n as f64).product::<f64>();
        let cell = (area / (CELLS * places.len().max(1) as f64)).sqrt().clamp(NARROW * reach, reach);
        self.origin = frame.0;
        self.inverse = 1.0 / cell;
        self.size = frame.1.map(|n| (n as f64 / cell) as usize + 1);
        self.starts.clear();
        self.starts.resize(self.size[0] * self.size[1] + 1, 0);
        self.cells.clear();
        for &place in places {
            let [x, y] = self.cell(place);
            let cell = y * self.size[0] + x;
            self.starts[cell + 1] += 1;
            self.cells.push(cell as u32);
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.items.clear();
        self.items.resize(places.len(), (0, [0.0; 2]));
        for (i, &place) in places.iter().enumerate().rev() {
            // counted down from the next cell's start
            let end = &mut self.starts[self.cells[i] as usize + 1];
            *end -= 1;
            self.items[*end as usize] = (i as u32, place);
        }
        // the former ends are now starts
        self.starts.remove(0);
        self.starts.push(places.len() as u32);
    }

    #[inline(always)]
    fn cell(&self, at: Place2) -> [usize; 2] {
        std::array::from_fn(|k| {
            (cut_off((at[k] - self.origin[k]) * self.inverse) as usize).min(self.size[k] - 1)
        })
    }

    /// Returns the places in the cells within reach of a place, by rows of cells.
    #[inline(always)]
    pub fn around(&self, at: Place2, reach: f64) -> impl Iterator<Item = &[(u32, Place2)]> {
        let [left, top] = self.cell(at.map(|x| x - reach));
        let [right, bottom] = self.cell(at.map(|x| x + reach));
        (top..=bottom).map(move |row| {
            let start = self.starts[row * self.size[0] + left] as usize;
            let end = self.starts[row * self.size[0] + right + 1] as usize;
            &self.items[start..end]
        })
    }

    /// Returns the nearest place within `reach`. A near place and its number, if known, shorten the search.
    #[inline]
    pub fn nearest(&self, at: Place2, reach: f64, near: Option<(usize, Place2)>) -> Option<usize> {
        let mut best = reach * reach;
        let mut found = None;
        if let Some((k, place)) = near {
            let d = (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
            if d < best {
                (best, found) = (d, Some(k));
            }
        }
        for run in self.around(at, best.sqrt()) {
            for &(i, place) in run {
                let d = (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
                if d < best {
                    best = d;
                    found = Some(i as usize);
                }
            }
        }
        found
    }

    /// Calls with all pairs i < j of places nearer than `reach`, and their squared distance.
    #[inline]
    pub fn pairs(&self, reach: f64, mut call: impl FnMut(usize, usize, f64)) {
        let [columns, rows] = self.size;
        let cells = (reach * self.inverse).ceil() as usize;
        let mut first = 0;
        while let Some(&(place, _)) = self.items.get(first) {
            let cell = self.cells[place as usize] as usize;
            let end = self.starts[cell + 1] as usize;
            let (x, y) = (cell % columns, cell / columns);
            let right = (x + cells).min(columns - 1);
            let run = |row: usize, left: usize| {
                let row = row * columns;
                self.starts[row + left] as usize..self.starts[row + right + 1] as usize
            };
            let below = (y + 1..(y + cells + 1).min(rows)).map(|row| run(row, x.saturating_sub(cells)));
            for i in first..end {
                let (number, at) = self.items[i];
                // each pair once: with the places after it in its row of cells, and those in the rows below
                let after = i + 1..run(y, x).end;
                for run in std::iter::once(after).chain(below.clone()) {
                    for &(other, place) in &self.items[run] {
                        let d = (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
                        if d < reach * reach {
                            call(number.min(other) as usize, number.max(other) as usize, d);
                        }
                    }
                }
            }
            first = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_and_pairs_are_those_of_a_full_search() {
        let place = |i: usize| {
            let t = i as f64;
            [40.0 * (t * 0.37).sin() + 20.0, 30.0 * (t * 0.61).cos() + 10.0]
        };
        let places: Vec<Place2> = (0..300).map(place).collect();
        let mut grid = Grid::default();
        let square = |a: Place2, b: Place2| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        // narrow cells and wide ones
        for frame in [[40, 30], [400, 300]] {
            for _ in 0..2 {
                grid.fill(&places, ([0.0, 0.0], frame), 4.0);
            }
            for i in 0..50 {
                let at = place(1000 + i);
                let full = (0..300).min_by(|&a, &b| square(places[a], at).total_cmp(&square(places[b], at)));
                let full = full.filter(|&k| square(places[k], at) < 16.0);
                assert_eq!(grid.nearest(at, 4.0, None), full);
                assert_eq!(grid.nearest(at, 4.0, Some((5 * i, places[5 * i]))), full);
            }
            for reach in [1.9, 3.5, 5.0] {
                let mut found = Vec::new();
                grid.pairs(reach, |i, j, _| found.push([i, j]));
                found.sort_unstable();
                let full: Vec<[usize; 2]> = (0..300)
                    .flat_map(|i| (i + 1..300).map(move |j| [i, j]))
                    .filter(|&[i, j]| square(places[i], places[j]) < reach * reach)
                    .collect();
                assert!(full.len() > 100, "{}", full.len());
                assert_eq!(found, full);
            }
        }
    }
}
