//! Planes fitted to covariances, and their normals turned to the cameras.

use crate::geometry::{Moments, Point, Symmetric3, dot, eigen_symmetric, least_eigenvectors, sub};
use crate::index::cells::Cells;
use crate::parallel::Slots;
use crate::simd::{LANES, kernel};

/// The cameras that saw the points; normals point towards them.
#[derive(Debug, Clone, Copy)]
pub enum Viewpoints<'a> {
    /// One camera saw all points.
    One(Point),
    /// The centre of the camera that saw each point.
    Each(&'a [Point]),
}

/// Where the fitted planes are stored.
pub struct Answers<'a> {
    pub viewpoints: Viewpoints<'a>,
    pub normals: Slots<'a, Point>,
    pub variation: Slots<'a, f64>,
}

impl Answers<'_> {
    /// Turns the normal of the input point `index` towards its camera and stores it.
    ///
    /// # Safety
    /// Only one task stores each index, and only once.
    #[inline(always)]
    pub unsafe fn put(&self, index: usize, point: Point, normal: Point, variation: f64) {
        let viewpoint = match self.viewpoints {
            Viewpoints::One(viewpoint) => viewpoint,
            Viewpoints::Each(all) => all[index],
        };
        // a product, not a branch: signs are as good as random
        let sign = if dot(normal, sub(viewpoint, point)) < 0.0 { -1.0 } else { 1.0 };
        // SAFETY: the caller stores each index once, so no two tasks write one slot of either array
        unsafe {
            self.normals.put(index, normal.map(|x| sign * x));
            self.variation.put(index, variation);
        }
    }
}

/// Covariances of the neighbourhoods of a task's points.
#[derive(Default)]
pub struct Covariances {
    /// The entries in the order of [`Symmetric3`]; each list ends with padding for the last row of lanes.
    entries: [Vec<f64>; 6],
    positions: Vec<u32>,
}

impl Covariances {
    pub fn add(&mut self, position: usize, covariance: Symmetric3) {
        for (list, entry) in self.entries.iter_mut().zip(covariance) {
            list.push(entry);
        }
        self.positions.push(position as u32);
    }

    /// Fits the planes and empties the lists.
    pub fn fit(&mut self, cells: &Cells, answers: &Answers) {
        self.entries
            .iter_mut()
            .for_each(|list| list.resize(self.positions.len().next_multiple_of(LANES), 0.0));
        fit_planes(&mut self.entries);
        let [x, y, z, variation, ..] = &self.entries;
        for ((((&position, &x), &y), &z), &variation) in
            self.positions.iter().zip(x).zip(y).zip(z).zip(variation)
        {
            let position = position as usize;
            // SAFETY: every position is in one task's list, once
            unsafe { answers.put(cells.input_index(position), cells.point(position), [x, y, z], variation) };
        }
        self.entries.iter_mut().for_each(Vec::clear);
        self.positions.clear();
    }
}

kernel! {
    /// Fits planes to some covariances, whose first four entries become the normals and the surface variations.
    fn fit_planes<S>(_, entries: &mut [Vec<f64>; 6]) {
        let mut lists = entries.each_mut().map(|list| list.as_chunks_mut::<LANES>().0);
        for row in 0..lists[0].len() {
            let matrices = lists.each_ref().map(|list| list[row]);
            let (vectors, shares, certain) = least_eigenvectors(&matrices);
            for k in 0..3 {
                lists[k][row] = vectors[k];
            }
            lists[3][row] = shares;
            for l in 0..LANES {
                if !certain[l] {
                    let ([x, y, z], variation) = plane(&matrices.map(|m| m[l]));
                    for (list, value) in lists.iter_mut().zip([x, y, z, variation]) {
                        list[row][l] = value;
                    }
                }
            }
        }
    }
}

/// Returns the normal and the surface variation of a covariance; zeros if it spans fewer than two directions.
#[cold]
pub fn plane(covariance: &Symmetric3) -> (Point, f64) {
    let eigen = eigen_symmetric(covariance);
    let [smallest, middle, largest] = eigen.values;
    // rounding leaves the points of a line a second direction, which is not enough
    if middle <= 1e-12 * largest {
        return ([0.0; 3], 0.0);
    }
    (eigen.vectors[0], (smallest / (smallest + middle + largest)).max(0.0))
}

/// Returns the covariance of a neighbourhood, or zeros if it is too small for a plane.
#[inline(always)]
pub fn covariance(moments: &Moments) -> Symmetric3 {
    if moments.count() < 3 { [0.0; 6] } else { moments.covariance() }
}
