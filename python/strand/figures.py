"""Draw a reconstruction: an HTML page, a recording for Rerun, and figures of every stage.

`write_report` and `write_recording` show a model together with its views. `show` opens Rerun's viewer.
`write_track_report` and `write_track_recording` play the answers of a `strand.Tracker`. `write_mcap`
writes models on their timeline for Foxglove.
`write_figures` draws all stages to PNG files, `plot_over_points` only the chains. Each other function
returns one figure as a `matplotlib.figure.Figure`; it needs a model from `strand.reconstruct(...,
keep_stages=True)`.
"""

from strand.report.figures import (
    draw_arcs,
    draw_cameras,
    draw_filtered,
    draw_raw,
    draw_registered,
    draw_residuals,
    draw_ropes,
    draw_uncertainty,
    plot_over_points,
    write_figures,
)
from strand.report.page import write_report
from strand.report.published_figures import (
    draw_axis_points,
    draw_chains,
    draw_normals,
    draw_segments,
    draw_separation,
)
from strand.report.rerun_tracks import write_track_recording
from strand.report.rerun_view import show, write_recording
from strand.report.scene_updates import write_mcap
from strand.report.track_page import write_track_report

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
    "write_mcap",
    "write_recording",
    "write_report",
    "write_track_recording",
    "write_track_report",
]
