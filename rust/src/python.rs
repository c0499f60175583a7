//! The Python bindings, one file for each topic. They validate, release the GIL, call the core and map errors. No
//! maths.

mod arguments;
mod arrays;
mod called;
mod centerline;
mod colors;
mod curves;
mod density;
mod errors;
mod filter;
mod fit;
mod heights;
mod icp;
mod image_fit;
mod images;
mod knots;
mod masks;
mod normals;
mod plain;
mod queries;
mod released;
mod statistics;
mod track;
mod tubes;
mod views;
mod visibility;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use errors::{NotEnoughDataError, StrandError};

/// Set how many threads the kernels use from now on.
///
/// Results do not depend on it.
///
/// Parameters
/// ----------
/// threads : int
///     The number of threads, at most 256; 0 for one for each core that the process may use now.
///
/// Raises
/// ------
/// ValueError
///     If `threads` is negative.
#[pyfunction]
fn set_num_threads(threads: &Bound<'_, PyAny>) -> PyResult<()> {
    crate::set_num_threads(arguments::count("threads", threads)?);
    Ok(())
}

/// Return how many threads the kernels use.
///
/// Returns
/// -------
/// int
#[pyfunction]
fn num_threads() -> usize {
    crate::num_threads()
}

/// Count the cores that this process may use, by its affinity and its control group's CPU quota.
#[pyfunction]
fn count_cores() -> usize {
    crate::parallel::cores()
}

// for interpreters without a GIL: statics are atomics and mutexes, classes are frozen, and arguments are copied first
#[pymodule(gil_used = false)]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    if let Err(text) = crate::parallel::threads_of_environment() {
        let reason = format!("{}: expected a whole number >= 0, got {text:?}", crate::parallel::VARIABLE);
        return Err(PyValueError::new_err(reason));
    }
    released::keep_panics_quiet();
    arrays::prepare(py)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("StrandError", py.get_type::<StrandError>())?;
    module.add("NotEnoughDataError", py.get_type::<NotEnoughDataError>())?;
    module.add_class::<fit::EndObservation>()?;
    module.add_class::<fit::TubeFit>()?;
    module.add_class::<icp::IcpResult>()?;
    module.add_class::<image_fit::ImageFit>()?;
    module.add_class::<images::RopeImages>()?;
    module.add_class::<masks::RopeMask>()?;
    module.add_class::<visibility::Visibility>()?;
    module.add_class::<queries::TubeQueries>()?;
    module.add_function(wrap_pyfunction!(views::copy_depth, module)?)?;
    module.add_function(wrap_pyfunction!(views::copy_constant, module)?)?;
    module.add_function(wrap_pyfunction!(views::find_centroids, module)?)?;
    module.add_function(wrap_pyfunction!(views::measure_shift, module)?)?;
    module.add_function(wrap_pyfunction!(views::unproject, module)?)?;
    module.add_function(wrap_pyfunction!(views::crop_points, module)?)?;
    module.add_function(wrap_pyfunction!(views::crop_images, module)?)?;
    module.add_function(wrap_pyfunction!(density::count_typical_neighbors, module)?)?;
    module.add_function(wrap_pyfunction!(density::count_seen, module)?)?;
    module.add_function(wrap_pyfunction!(density::count_voxels, module)?)?;
    module.add_function(wrap_pyfunction!(density::find_nearest, module)?)?;
    module.add_function(wrap_pyfunction!(density::find_squared_distances, module)?)?;
    module.add_function(wrap_pyfunction!(density::measure_variances, module)?)?;
    module.add_function(wrap_pyfunction!(views::measure_depth_bends, module)?)?;
    module.add_function(wrap_pyfunction!(views::measure_behind, module)?)?;
    module.add_function(wrap_pyfunction!(visibility::occludes, module)?)?;
    module.add_function(wrap_pyfunction!(filter::radius_outlier_mask, module)?)?;
    module.add_function(wrap_pyfunction!(filter::count_neighbors, module)?)?;
    module.add_function(wrap_pyfunction!(filter::count_neighbors_each, module)?)?;
    module.add_function(wrap_pyfunction!(normals::estimate_normals, module)?)?;
    module.add_function(wrap_pyfunction!(normals::estimate_normals_each, module)?)?;
    module.add_function(wrap_pyfunction!(icp::icp, module)?)?;
    module.add_function(wrap_pyfunction!(icp::register_in_turn, module)?)?;
    module.add_function(wrap_pyfunction!(centerline::centerline, module)?)?;
    module.add_function(wrap_pyfunction!(centerline::trace_chains, module)?)?;
    module.add_function(wrap_pyfunction!(tubes::estimate_radii, module)?)?;
    module.add_function(wrap_pyfunction!(tubes::trace_tubes, module)?)?;
    module.add_function(wrap_pyfunction!(tubes::find_seen_ends, module)?)?;
    module.add_function(wrap_pyfunction!(fit::fit_tubes, module)?)?;
    module.add_function(wrap_pyfunction!(fit::find_extents, module)?)?;
    module.add_function(wrap_pyfunction!(fit::average_residuals, module)?)?;
    module.add_function(wrap_pyfunction!(curves::fit_spline, module)?)?;
    module.add_function(wrap_pyfunction!(curves::evaluate_spline, module)?)?;
    module.add_function(wrap_pyfunction!(curves::tabulate_arc_length, module)?)?;
    module.add_function(wrap_pyfunction!(curves::interpolate, module)?)?;
    module.add_function(wrap_pyfunction!(curves::find_parameters, module)?)?;
    module.add_function(wrap_pyfunction!(curves::find_arc_lengths, module)?)?;
    module.add_function(wrap_pyfunction!(curves::propagate_covariances, module)?)?;
    module.add_function(wrap_pyfunction!(curves::find_contacts, module)?)?;
    module.add_function(wrap_pyfunction!(curves::find_overlaps, module)?)?;
    module.add_function(wrap_pyfunction!(curves::find_crossed_segments, module)?)?;
    module.add_function(wrap_pyfunction!(curves::find_runs, module)?)?;
    module.add_function(wrap_pyfunction!(curves::path_length, module)?)?;
    module.add_function(wrap_pyfunction!(curves::end_direction, module)?)?;
    module.add_function(wrap_pyfunction!(curves::bridge_nodes, module)?)?;
    module.add_function(wrap_pyfunction!(curves::straightened, module)?)?;
    module.add_function(wrap_pyfunction!(curves::measure_bending, module)?)?;
    module.add_function(wrap_pyfunction!(curves::price_join, module)?)?;
    module.add_function(wrap_pyfunction!(knots::identify_knot, module)?)?;
    module.add_function(wrap_pyfunction!(knots::draw_knot, module)?)?;
    module.add_function(wrap_pyfunction!(knots::find_order_probability, module)?)?;
    module.add_function(wrap_pyfunction!(knots::find_linking_number, module)?)?;
    module.add_function(wrap_pyfunction!(masks::convolved, module)?)?;
    module.add_function(wrap_pyfunction!(masks::count_mask_parts, module)?)?;
    module.add_function(wrap_pyfunction!(masks::number_blobs, module)?)?;
    module.add_function(wrap_pyfunction!(masks::count_odd_pixels, module)?)?;
    module.add_function(wrap_pyfunction!(masks::select_beside, module)?)?;
    module.add_function(wrap_pyfunction!(masks::find_pieces_beside, module)?)?;
    module.add_function(wrap_pyfunction!(masks::find_strip_middles, module)?)?;
    module.add_function(wrap_pyfunction!(masks::measure_edge_distances, module)?)?;
    module.add_function(wrap_pyfunction!(masks::find_short_outlines, module)?)?;
    module.add_function(wrap_pyfunction!(masks::trace_skeleton, module)?)?;
    module.add_function(wrap_pyfunction!(heights::measure_heights, module)?)?;
    module.add_function(wrap_pyfunction!(heights::find_standing, module)?)?;
    module.add_function(wrap_pyfunction!(heights::find_plane, module)?)?;
    module.add_function(wrap_pyfunction!(heights::measure_plane_errors, module)?)?;
    module.add_function(wrap_pyfunction!(heights::find_tabletop, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::count_disc_pairs, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::find_median, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::find_values_near, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::measure_linear_scatter, module)?)?;
    module.add_function(wrap_pyfunction!(colors::convert_to_lab, module)?)?;
    module.add_function(wrap_pyfunction!(colors::find_color_pieces, module)?)?;
    module.add_function(wrap_pyfunction!(colors::draw_ropes, module)?)?;
    module.add_function(wrap_pyfunction!(track::track_frame, module)?)?;
    module.add_function(wrap_pyfunction!(set_num_threads, module)?)?;
    module.add_function(wrap_pyfunction!(count_cores, module)?)?;
    module.add_function(wrap_pyfunction!(num_threads, module)?)
}
