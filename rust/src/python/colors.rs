//! Bindings of ropes in colour images.

use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::Array;
use super::arrays::array;
use super::released::released;
use crate::images::color::Planes;
use crate::images::color::lab;
use crate::images::color::pieces::{self, Band, Piece};
use crate::images::color::strips::{self, StripOptions, Strips};
use crate::images::image::Image;

const COLUMNS: usize = 21; // numbers that describe a piece

/// A band: the factor that its image is smaller by, its half width, the pieces' numbers (h, w), their descriptions.
type BandOfPieces<'py> = (usize, f64, Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<f64>>);

/// Return (3, H, W) Lab of an (H, W, 3) image of bytes in sRGB.
#[pyfunction]
pub(super) fn convert_to_lab<'py>(
    py: Python<'py>,
    colors: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let colors = Array::<u8>::exactly("colors", colors, 3)?;
    let &[height, width, 3] = colors.shape() else {
        return Err(PyValueError::new_err("colors: expected (H, W, 3)"));
    };
    let values = colors.into_values();
    let found = released(py, move || lab::convert_to_lab(&values, width).map(|plane| plane.values).concat())?;
    array(py, found, [3, height, width])
}

/// Return the strongest strip at each pixel of (3, H, W) planes: (3, H, W) response, half width, difference of both sides.
#[pyfunction]
pub(super) fn find_strips<'py>(
    py: Python<'py>,
    planes: &Bound<'py, PyAny>,
    max_width: f64,
    min_contrast: f32,
    noise: f32,
    aside: f32,
    signed: bool,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let planes = take_planes("planes", planes)?;
    let (width, height) = (planes[0].width, planes[0].height);
    let options = StripOptions { max_width, min_contrast, noise, aside, signed };
    let found = released(py, move || {
        let found = strips::find_strips(&planes, &options);
        [found.response.values, found.half_width.values, found.aside.values].concat()
    })?;
    array(py, found, [3, height, width])
}

/// Return the pieces of strips of each width.
///
/// `planes` decide about regions, and `lab` gives colours; without it, `planes` do. For each width: the factor that its
/// image is smaller by, the half width, the pieces' numbers (h, w), and 21 numbers for each piece.
#[pyfunction]
#[pyo3(signature = (planes, lab, strips))]
pub(super) fn find_color_pieces<'py>(
    py: Python<'py>,
    planes: &Bound<'py, PyAny>,
    lab: Option<&Bound<'py, PyAny>>,
    strips: &Bound<'py, PyAny>,
) -> PyResult<Vec<BandOfPieces<'py>>> {
    let planes = take_planes("planes", planes)?;
    let lab = lab.map(|lab| take_planes("lab", lab)).transpose()?;
    let [response, half_width, aside] = take_planes("strips", strips)?;
    let size = |image: &Image<f32>| [image.width, image.height];
    if size(&response) != size(&planes[0])
        || lab.as_ref().is_some_and(|lab| size(&lab[0]) != size(&planes[0]))
    {
        return Err(PyValueError::new_err("planes, lab, strips: expected one size"));
    }
    let bands = released(py, move || {
        let strips = Strips { response, half_width, aside };
        pieces::find_pieces(&planes, lab.as_ref().unwrap_or(&planes), lab.is_none(), &strips)
    })?;
    bands.into_iter().map(|band| convert_band(py, band)).collect()
}

fn convert_band(py: Python<'_>, band: Band) -> PyResult<BandOfPieces<'_>> {
    let numbers: Vec<f64> = band.pieces.iter().flat_map(list_numbers).collect();
    let size = [band.labels.height, band.labels.width];
    Ok((
        band.factor,
        band.half_width,
        array(py, band.labels.values, size)?,
        array(py, numbers, [band.pieces.len(), COLUMNS])?,
    ))
}

fn list_numbers(piece: &Piece) -> [f64; COLUMNS] {
    let mut found = [0.0; COLUMNS];
    let (c, b) = (piece.color, piece.background);
    let lengths = [piece.half_width, piece.length, piece.extent, piece.widest, piece.even];
    let looks = [piece.contrast, piece.response, piece.aside, piece.scatter, piece.soft, piece.pure];
    let singles = lengths.into_iter().chain(c).chain(b).chain(looks).map(f64::from);
    let all = singles.chain(piece.bounds.map(|side| side as f64));
    found.iter_mut().zip(all).for_each(|(to, value)| *to = value);
    found
}

/// Takes an array (3, H, W) of finite numbers.
fn take_planes(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Planes> {
    let planes = Array::<f32>::exactly(name, value, 3)?;
    let &[3, height, width] = planes.shape() else {
        return Err(PyValueError::new_err(format!("{name}: expected (3, H, W)")));
    };
    if width == 0 || height == 0 {
        return Err(PyValueError::new_err(format!("{name}: expected at least one pixel")));
    }
    let values = planes.slice();
    let size = width * height;
    Ok([0, 1, 2].map(|k| Image { width, height, values: values[k * size..(k + 1) * size].to_vec() }))
}
