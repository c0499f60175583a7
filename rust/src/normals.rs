//! Surface normals by principal components (section IV-B, eq. 10–14).
//!
//! Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.

use crate::checks::{check_finite, check_positive, check_same_length};
use crate::error::Result;
use crate::geometry::{Moments, Point, Symmetric3, dot, eigen_symmetric, least_eigenvectors, sub};
use crate::index::around::{Around, Frame, squared_distances};
use crate::index::cells::Cells;
use crate::index::hierarchy::crowded::Crowded;
use crate::parallel;
use crate::parallel::Slots;
use crate::simd::{BATCH, LANES, Simd, Singles, kernel};
use mass::Mass;

mod mass;
mod nearest;

const CELLS: f64 = 1.0; // width of a cell, radii

/// The points that a normal is fitted to. The point itself is one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Neighbors {
    /// The k nearest points, k ≥ 3.
    Nearest(usize),
    /// All points within a radius, metres.
    Within(f64),
}

/// The cameras that saw the points; normals point towards them.
#[derive(Debug, Clone, Copy)]
pub enum Viewpoints<'a> {
    /// One camera saw all points.
    One(Point),
    /// The centre of the camera that saw each point.
    Each(&'a [Point]),
}

/// Normals, and how well each is determined.
#[derive(Debug, Clone, PartialEq)]
pub struct Normals {
    /// Outward unit normals; the zero vector where the neighbours do not span a plane.
    pub normals: Vec<Point>,
    /// Surface variation λ₀ / (λ₀ + λ₁ + λ₂) of the neighbourhood: 0 on a plane, 1/3 at most; 0 where there is no
    /// normal.
    pub variation: Vec<f64>,
}

/// Estimates surface normals by fitting planes to neighbourhoods.
///
/// The normal n minimises Σ (n·q_i − d)², d = n·q̄ (eq. 10–13): it is the eigenvector of the neighbours' covariance
/// with the smallest eigenvalue, turned towards the camera (eq. 14). A neighbourhood of fewer than three points, or of
/// points on a line or in one place, has no plane; its normal is the zero vector.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite, the radius is not positive, k < 3,
/// or there is not one viewpoint for each point; [`NotEnoughData`](crate::Error::NotEnoughData) if there are fewer than
/// k points.
pub fn estimate_normals(points: &[Point], neighbors: Neighbors, viewpoints: Viewpoints) -> Result<Normals> {
    check_finite("points", points)?;
    match viewpoints {
        Viewpoints::One(viewpoint) => check_finite("viewpoint", &[viewpoint])?,
        Viewpoints::Each(all) => {
            check_same_length("viewpoint", all.len(), "points", points.len())?;
            check_finite("viewpoint", all)?;
        }
    }
    let mut normals = vec![[0.0; 3]; points.len()];
    let mut variation = vec![0.0; points.len()];
    let answers =
        Answers { viewpoints, normals: Slots::new(&mut normals), variation: Slots::new(&mut variation) };
    match neighbors {
        Neighbors::Nearest(k) => nearest::fit(points, k, &answers)?,
        Neighbors::Within(radius) => {
            check_positive("radius", radius)?;
            parallel::run(|| fit_within(points, radius, &answers));
        }
    }
    Ok(Normals { normals, variation })
}

/// Where the fitted planes are stored.
struct Answers<'a> {
    viewpoints: Viewpoints<'a>,
    normals: Slots<'a, Point>,
    variation: Slots<'a, f64>,
}

impl Answers<'_> {
    /// Turns the normal of the input point `index` towards its camera and stores it.
    ///
    /// # Safety
    /// Only one task stores each index, and only once.
    #[inline(always)]
    unsafe fn put(&self, index: usize, point: Point, normal: Point, variation: f64) {
        let viewpoint = match self.viewpoints {
            Viewpoints::One(viewpoint) => viewpoint,
            Viewpoints::Each(all) => all[index],
        };
        let away = dot(normal, sub(viewpoint, point)) < 0.0;
        // SAFETY: the caller stores each index once, so no two tasks write one slot of either array
        unsafe {
            self.normals.put(index, if away { normal.map(|x| -x) } else { normal });
            self.variation.put(index, variation);
        }
    }
}

/// Covariances of the neighbourhoods of a task's points.
#[derive(Default)]
struct Covariances {
    /// The entries in the order of [`Symmetric3`]; each list ends with padding for the last row of lanes.
    entries: [Vec<f64>; 6],
    positions: Vec<u32>,
}

impl Covariances {
    fn add(&mut self, position: usize, covariance: Symmetric3) {
        for (list, entry) in self.entries.iter_mut().zip(covariance) {
            list.push(entry);
        }
        self.positions.push(position as u32);
    }

    /// Fits the planes and empties the lists.
    fn fit(&mut self, cells: &Cells, answers: &Answers) {
        self.entries
            .iter_mut()
            .for_each(|list| list.resize(self.positions.len().next_multiple_of(LANES), 0.0));
        fit_planes(self, cells, answers);
        self.entries.iter_mut().for_each(Vec::clear);
        self.positions.clear();
    }
}

kernel! {
    /// Fits planes to some covariances.
    fn fit_planes<S>(_, covariances: &Covariances, cells: &Cells, answers: &Answers) {
        let rows = covariances.entries.each_ref().map(|list| list.as_chunks::<LANES>().0);
        for (row, positions) in covariances.positions.chunks(LANES).enumerate() {
            let matrices = rows.map(|list| list[row]);
            let (vectors, shares, certain) = least_eigenvectors(&matrices);
            for (l, &position) in positions.iter().enumerate() {
                let (normal, variation) = if certain[l] {
                    (vectors.map(|v| v[l]), shares[l])
                } else {
                    plane(&matrices.map(|m| m[l]))
                };
                let position = position as usize;
                // SAFETY: every position is in one task's list, once
                unsafe { answers.put(cells.input_index(position), cells.point(position), normal, variation) };
            }
        }
    }
}

/// Returns the normal and the surface variation of a covariance; zeros if it spans fewer than two directions.
#[cold]
fn plane(covariance: &Symmetric3) -> (Point, f64) {
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
fn covariance(moments: &Moments) -> Symmetric3 {
    if moments.count() < 3 { [0.0; 6] } else { moments.covariance() }
}

fn fit_within(points: &[Point], radius: f64, answers: &Answers) {
    let cells = Cells::new(points, radius / CELLS);
    let crowded = Crowded::default();
    cells.batches().for_each_task(|batches| {
        let mut around = Around::default();
        let mut sums = Sums::default();
        let mut covariances = Covariances::default();
        for batch in batches {
            let open = sum_within(&cells, radius, batch, &mut around, &mut sums);
            let Some(open) = open else {
                crowded.add(batch.iter().map(|&position| cells.input_index(position as usize)));
                continue;
            };
            for (l, &position) in batch.iter().enumerate() {
                let position = position as usize;
                let covariance = sums.covariance(l).filter(|_| !open[l]).unwrap_or_else(|| {
                    let center = cells.point(position);
                    let mut moments = Moments::default();
                    for i in around.positions() {
                        let d = sub(cells.point(i), center);
                        if dot(d, d) <= radius * radius {
                            moments.add(d);
                        }
                    }
                    moments.covariance()
                });
                covariances.add(position, covariance);
            }
        }
        covariances.fit(&cells, answers);
    });
    drop(cells);
    let fitted = |mass: Mass| plane(&mass.covariance());
    // SAFETY: every point has one answer
    let put = |i: usize, plane: &(Point, f64)| unsafe { answers.put(i, points[i], plane.0, plane.1) };
    crowded.answer(points, radius, |i| Mass::of(points[i]), fitted, put);
}

kernel! {
    /// Sums over the points within a radius of each point of a batch, and reports the points for which single precision
    /// does not decide. None where cells are crowded.
    fn sum_within<S>(
        simd,
        cells: &Cells,
        radius: f64,
        batch: &[u32],
        around: &mut Around,
        sums: &mut Sums,
    ) -> Option<[bool; BATCH]> {
        let frame = around.find(simd, cells, &cells.bounds(batch), radius)?;
        let lanes = frame.lanes(batch.iter().map(|&position| cells.point(position as usize)));
        let (low, high) = frame.limits(radius);
        sums.measure(simd, around, &lanes);
        sums.add(simd, cells, around, &frame, &[low; BATCH]);
        let maybe = sums.count_below(simd, &[high; BATCH]);
        Some(std::array::from_fn(|l| maybe[l] != sums.counts[l]))
    }
}

/// Sums over the neighbours of each point of a batch, relative to a place near them.
#[derive(Default)]
struct Sums {
    /// Squared distances from each point around to each point of the batch.
    squares: Vec<Singles>,
    count: usize,
    /// Coordinates of the points around.
    near: Vec<Point>,
    counts: Singles,
    /// Sums of x, y, z, xx, xy, xz, yy, yz and zz.
    sums: [[f64; BATCH]; 9],
    /// Neighbourhoods with a smaller squared size lose too much precision in these sums.
    smallest: f64,
}

impl Sums {
    /// Computes the distances.
    #[inline(always)]
    fn measure<S: Simd>(&mut self, simd: S, around: &Around, lanes: &[Singles; 3]) {
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let [x, y, z] = around.axes();
        if self.squares.len() < x.len() {
            self.squares.resize(2 * x.len(), [0.0; BATCH]);
        }
        self.count = x.len();
        for (((&x, &y), &z), squares) in x.iter().zip(y).zip(z).zip(&mut self.squares) {
            *squares = simd.store(squared_distances(simd, x, y, z, lanes));
        }
    }

    /// Counts the squared distances within each lane's limit.
    #[inline(always)]
    fn count_below<S: Simd>(&self, simd: S, limits: &Singles) -> Singles {
        let (limits, one) = (simd.load(limits), simd.splat(1.0));
        // several sums, so that none waits for another
        let mut counts = [simd.splat(0.0); 4];
        let (fours, rest) = self.squares[..self.count].as_chunks::<4>();
        for four in fours {
            for i in 0..4 {
                counts[i] =
                    simd.select(simd.le(simd.load(&four[i]), limits), simd.add(counts[i], one), counts[i]);
            }
        }
        for squares in rest {
            counts[0] = simd.select(simd.le(simd.load(squares), limits), simd.add(counts[0], one), counts[0]);
        }
        simd.store(simd.add(simd.add(counts[0], counts[1]), simd.add(counts[2], counts[3])))
    }

    /// Adds the points around whose squared distances are within each lane's limit.
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, cells: &Cells, around: &Around, frame: &Frame, limits: &Singles) {
        self.near.clear();
        self.near.extend(around.positions().map(|position| sub(cells.point(position), frame.origin)));
        self.counts = self.count_below(simd, limits);
        if S::MANY_REGISTERS {
            self.add_terms::<S, true, true, 0, 9>(simd, limits);
        } else {
            // few sums at a time, so that all stay in registers
            self.add_terms::<S, true, false, 0, 5>(simd, limits);
            self.add_terms::<S, true, false, 5, 9>(simd, limits);
            self.add_terms::<S, false, true, 0, 5>(simd, limits);
            self.add_terms::<S, false, true, 5, 9>(simd, limits);
        }
        self.smallest = 1e-3 * frame.extent * frame.extent;
    }

    /// Adds the terms from one number up to another, in the lanes of the first half, the second, or both.
    #[inline(always)]
    fn add_terms<S: Simd, const FIRST: bool, const SECOND: bool, const FROM: usize, const TO: usize>(
        &mut self,
        simd: S,
        limits: &Singles,
    ) {
        let limits = simd.load(limits);
        let (mut first, mut second) = ([simd.splat_half(0.0); 9], [simd.splat_half(0.0); 9]);
        for (&[x, y, z], squares) in self.near.iter().zip(&self.squares[..self.count]) {
            let mask = simd.le(simd.load(squares), limits);
            let terms = [x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
            for i in FROM..TO {
                let term = simd.splat_half(terms[i]);
                if FIRST {
                    first[i] = simd.add_half_if(simd.half::<false>(mask), first[i], term);
                }
                if SECOND {
                    second[i] = simd.add_half_if(simd.half::<true>(mask), second[i], term);
                }
            }
        }
        for i in FROM..TO {
            if FIRST {
                self.sums[i][..LANES].copy_from_slice(&simd.store_half(first[i]));
            }
            if SECOND {
                self.sums[i][LANES..].copy_from_slice(&simd.store_half(second[i]));
            }
        }
    }

    /// Returns the covariance of a lane's neighbourhood, zeros if it is too small for a plane; None if precision is
    /// lost.
    fn covariance(&self, lane: usize) -> Option<Symmetric3> {
        let n = f64::from(self.counts[lane]);
        if n < 3.0 {
            return Some([0.0; 6]);
        }
        let [x, y, z, xx, xy, xz, yy, yz, zz] = self.sums.each_ref().map(|sums| sums[lane] / n);
        let covariance = [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z];
        (covariance[0] + covariance[3] + covariance[5] > self.smallest).then_some(covariance)
    }
}
