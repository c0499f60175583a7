"""Pictures of a reconstruction: pages, recordings for a viewer, and figures of every stage.

`write_report` and `write_recording` show a model and its views together; `show` opens Rerun's viewer.
`write_figures` draws every stage to PNG files, and `plot_over_points` the chains alone. The other functions
make one of these figures each, as a `matplotlib.figure.Figure` to show or change; they take a model with its
stages, from `strand.reconstruct(..., keep_stages=True)`.
"""

from strand.report.figures import (
    draw_arcs,
    draw_axis_points,
    draw_cameras,
    draw_chains,
    draw_filtered,
    draw_normals,
    draw_raw,
    draw_registered,
    draw_residuals,
    draw_ropes,
    draw_segments,
    draw_separation,
    draw_uncertainty,
    plot_over_points,
    write_figures,
)
from strand.report.page import write_report
from strand.report.rerun_view import show, write_recording

__all__ = [
    "draw_arcs",
    "draw_axis_points",
    "draw_cameras",
    "draw_chains",
    "draw_filtered",
    "draw_normals",
    "draw_raw",
    "draw_registered",
    "draw_residuals",
    "draw_ropes",
    "draw_segments",
    "draw_separation",
    "draw_uncertainty",
    "plot_over_points",
    "show",
    "write_figures",
    "write_recording",
    "write_report",
]
