//! Bindings of images and masks: smoothing, blobs, outlines, radii.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, wrong_shape};
use super::arrays::{array, list};
use super::released::{CHEAP, released, released_if_long, released_if_many};
use crate::checks::check_positive;
use crate::images::beside;
use crate::images::bits::Bits;
use crate::images::distances::measure_distances;
use crate::images::image::{Image, find_blobs};
use crate::images::outline;
use crate::images::parts::count_parts;
use crate::images::readings;
use crate::images::rope_mask;
use crate::images::strips;
use crate::parallel;

/// The columns and rows of a strand's nodes.
type Strand<'py> = Bound<'py, PyArray2<f64>>;

/// The first row and column of a part of an image, and which of its pixels are a piece's.
type Piece<'py> = ((usize, usize), Bound<'py, PyArray2<bool>>);

const MAX_STEPS: usize = 100_000; // steps of an outline at most; it takes hundreds

/// Convolve an image (H, W) along rows and columns with a symmetric kernel, given from its middle on, in single
/// precision; beyond the border are zeros.
#[pyfunction]
pub(super) fn convolved<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    mut kernel: Vec<f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let image = Array::<f32>::exactly("image", image, 2)?;
    let ([height, width], values) = (image.image_shape("image")?, image.into_values());
    if kernel.is_empty() || values.is_empty() {
        return Err(PyValueError::new_err("image, kernel: expected at least one number"));
    }
    // entries farther out than the image is wide lie beyond the border
    kernel.truncate(width.max(height));
    let found = released(py, move || {
        let reach = kernel.len() - 1;
        let wide = width + 2 * reach;
        let mut padded = Image::filled(wide, height + 2 * reach, 0.0f32);
        for (row, from) in values.chunks_exact(width).enumerate() {
            padded.values[(row + reach) * wide + reach..][..width].copy_from_slice(from);
        }
        let found = padded.convolved(&kernel);
        let rows = found.values.chunks_exact(wide).skip(reach).take(height);
        rows.flat_map(|row| &row[reach..reach + width]).copied().collect::<Vec<f32>>()
    })?;
    array(py, found, [height, width])
}

/// Return the number of pixels of a mask's largest piece, the number of its pieces of at least `piece` pixels, and the
/// number of its enclosed holes of at least `hole` pixels; diagonal neighbours are connected.
#[pyfunction]
pub(super) fn count_mask_parts(
    py: Python<'_>,
    mask: &Bound<'_, PyAny>,
    piece: f64,
    hole: f64,
) -> PyResult<(usize, usize, usize)> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    let parts = released_if_many(py, height * width / CHEAP, move || count_parts(&image, piece, hole))?;
    Ok((parts.largest, parts.pieces, parts.holes))
}

/// Return (H, W) numbers of each pixel's blob, from 1 on, 0 outside the mask; diagonal neighbours are connected.
#[pyfunction]
pub(super) fn number_blobs<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    let found = released_if_long(py, height * width, move || {
        let mut numbers = vec![0i64; width * height];
        for run in find_blobs(&image, true, true).runs {
            numbers[run.row * width..][run.begin..run.end].fill(run.blob as i64 + 1);
        }
        numbers
    })?;
    array(py, found, [height, width])
}

/// Return the number of pixels that differ from most of their neighbours, and of the steps of a mask's outline.
#[pyfunction]
pub(super) fn count_odd_pixels(py: Python<'_>, mask: &Bound<'_, PyAny>) -> PyResult<(usize, usize)> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    released_if_many(py, height * width / CHEAP, move || {
        Bits::pack(mask.slice(), width).count_odd_pixels().into()
    })
}

/// Return rows, columns and depths (N,) of pixels with depth in the box around a mask, `reach` pixels wider, that are
/// farther than `margin` pixels from it. About twice `count` pixels on a grid are examined.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(super) fn select_beside<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
    depth: &Bound<'py, PyAny>,
    reach: usize,
    margin: usize,
    count: f64,
) -> PyResult<(Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>)> {
    let (mask, depth) = (Array::mask("mask", mask)?, FloatArray::new("depth", depth)?);
    let [height, width] = depth.image_shape("depth")?;
    if mask.shape() != [height, width] {
        return Err(wrong_shape("mask", &format!("({height}, {width})"), mask.shape()));
    }
    check_positive("count", count)?;
    let found = released_if_long(py, height * width / 2, move || {
        beside::select_beside(&Bits::pack(mask.slice(), width), depth.slice(), reach, margin, count)
    })?;
    Ok((list(py, found.rows)?, list(py, found.columns)?, list(py, found.depths)?))
}

/// Return the connected pieces of chosen pixels farther than `reach` pixels from a mask. The number of pixels of each,
/// over `unit`, is between two limits. A piece has a part of the image, with `margin` pixels around it: the first row
/// and column of the part, and which of its pixels are the piece's.
#[pyfunction]
pub(super) fn find_pieces_beside<'py>(
    py: Python<'py>,
    chosen: &Bound<'py, PyAny>,
    mask: &Bound<'py, PyAny>,
    reach: f64,
    unit: f64,
    limits: [f64; 2],
    margin: usize,
) -> PyResult<Vec<Piece<'py>>> {
    let (chosen, mask) = (Array::mask("chosen", chosen)?, Array::mask("mask", mask)?);
    let [height, width] = mask.image_shape("mask")?;
    if chosen.shape() != [height, width] {
        return Err(wrong_shape("chosen", &format!("({height}, {width})"), chosen.shape()));
    }
    let found = released_if_long(py, 2 * height * width, move || {
        let [chosen, mask] = [chosen.slice(), mask.slice()].map(|values| Bits::pack(values, width));
        let size = |pixels: usize| limits[0] < pixels as f64 / unit && (pixels as f64 / unit) < limits[1];
        beside::find_pieces(&chosen, &mask, reach.min((width + height) as f64), size, margin)
    })?;
    found.into_iter().map(|piece| Ok((piece.corner.into(), array(py, piece.values, piece.size)?))).collect()
}

/// Return the middles of a mask's strips: pixels at least as far from its edge as their neighbours, and farther than
/// `least` pixels. Beyond the border counts as mask.
///
/// Returns
/// -------
/// pixels : (N,) ndarray of int
///     Their indices in the flat mask, ascending.
/// away : (N,) ndarray of float32
///     Their distances from the nearest pixel outside the mask, pixels.
/// blobs : (N,) ndarray of int
///     Numbers of their blobs, as `number_blobs` gives them.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(super) fn find_strip_middles<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
    least: f32,
) -> PyResult<(Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<i64>>)> {
    let mask = Array::mask("mask", mask)?;
    let [_, width] = mask.image_shape("mask")?;
    let found = released(py, move || strips::find_middles(mask.slice(), width, least))?;
    let pixels = found.iter().map(|middle| middle.pixel as i64).collect();
    let away = found.iter().map(|middle| middle.away).collect();
    let blobs = found.iter().map(|middle| middle.blob as i64 + 1).collect();
    Ok((list(py, pixels)?, list(py, away)?, list(py, blobs)?))
}

/// Return (H, W) distances of a mask's pixels from the nearest pixel outside it, pixels; 0 outside. Beyond the border
/// counts as mask. Distances above `most` may be wrong, but stay above `most`.
#[pyfunction]
pub(super) fn measure_edge_distances<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
    most: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    let most = most.min(width + height);
    let found =
        released_if_long(py, 2 * height * width, move || measure_distances(&image, true, most).values)?;
    array(py, found, [height, width])
}

/// Thin a mask to lines, and trace them.
///
/// Returns
/// -------
/// groups : (K, 2) ndarray
///     Mean row and column of each group of pixels where lines meet.
/// lines : list of ((M, 2) ndarray of int, (int, int))
///     For each line: rows and columns of its pixels in order, and the number of the group that each end touches, -1 for
///     none.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(super) fn trace_skeleton<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Vec<(Bound<'py, PyArray2<i64>>, (i64, i64))>)> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    let traced = released(py, move || readings::trace(&image))?;
    let groups = array(py, traced.groups.as_flattened().to_vec(), [traced.groups.len(), 2])?;
    let lines: PyResult<Vec<_>> = traced
        .lines
        .into_iter()
        .map(|(pixels, ends)| {
            let count = pixels.len();
            Ok((array(py, pixels.into_flattened(), [count, 2])?, (ends[0], ends[1])))
        })
        .collect();
    Ok((groups, lines?))
}

/// Return (H, W) pixels for each weight: the set with the least sum of evidence plus the weight times the length of its
/// outline.
#[pyfunction]
pub(super) fn find_short_outlines<'py>(
    py: Python<'py>,
    evidence: &Bound<'py, PyAny>,
    weights: Vec<f32>,
    steps: usize,
) -> PyResult<Vec<Bound<'py, PyArray2<bool>>>> {
    let evidence = Array::<f32>::exactly("evidence", evidence, 2)?;
    let [height, width] = evidence.image_shape("evidence")?;
    if steps > MAX_STEPS {
        return Err(PyValueError::new_err(format!("steps: expected at most {MAX_STEPS}, got {steps}")));
    }
    let evidence = Image { width, height, values: evidence.into_values() };
    let nanoseconds = (width * height).saturating_mul((steps + 1) * weights.len()) / 4;
    let found = released_if_long(py, nanoseconds, move || {
        parallel::map(&weights, |&weight| outline::find_short_outline(&evidence, weight, steps).values)
    })?;
    found.into_iter().map(|mask| array(py, mask, [height, width])).collect()
}

/// A mask of ropes whose radius is not known.
///
/// Parameters
/// ----------
/// mask : (H, W) ndarray of bool
#[pyclass(frozen, module = "strand._core")]
pub(super) struct RopeMask(Arc<rope_mask::RopeMask>);

#[pymethods]
impl RopeMask {
    #[new]
    fn new(py: Python<'_>, mask: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mask = Array::mask("mask", mask)?;
        let [height, width] = mask.image_shape("mask")?;
        let pack = move || rope_mask::RopeMask::new(mask.slice(), width);
        Ok(Self(Arc::new(released_if_many(py, height * width / CHEAP, pack)?)))
    }

    /// Estimate the ropes' radius in the image from the widths of the mask, pixels; None if it shows no rope.
    fn estimate_radius(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        let mask = self.0.clone();
        released_if_long(py, mask.nanoseconds, move || mask.estimate_radius())
    }

    /// Measure the radius of the ropes by the area of single strands, pixels, and their middles, columns and rows; None
    /// without such. `radius_px` is the radius roughly.
    fn measure_strands<'py>(
        &self,
        py: Python<'py>,
        radius_px: f64,
    ) -> PyResult<Option<(f64, Vec<Strand<'py>>)>> {
        check_positive("radius_px", radius_px)?;
        let mask = self.0.clone();
        let found =
            released_if_long(py, mask.nanoseconds, move || readings::measure_strands(&mask, radius_px))?;
        let Some((radius, strands)) = found else { return Ok(None) };
        let strands = strands
            .into_iter()
            .map(|nodes| array(py, nodes.concat(), [nodes.len(), 2]))
            .collect::<PyResult<_>>()?;
        Ok(Some((radius, strands)))
    }
}
