"""Layout of the viewer: path and landmarks, event images, curves, one under the other."""

from __future__ import annotations

from typing import Any

TIMELINE = "time"
"""Seconds of the recording."""
BLUE, ORANGE, GREEN, GREY = (0, 114, 178), (213, 94, 0), (0, 158, 115), (120, 120, 120)
AXES = ("x", "y", "z")
CURVES = {
    "linear_velocity": "linear velocity [m/s] and 3 sigma: x blue, y orange, z green",
    "angular_velocity": "angular velocity [rad/s] and 3 sigma: x blue, y orange, z green",
    "tracklets": "tracklets and inliers per cluster",
    "stages": "time per cluster [ms]",
}
"""Entities of curves, and their titles."""

WITH_LEGEND = ("tracklets", "stages")


def layout() -> Any:
    """Return the blueprint."""
    import rerun.blueprint as rrb

    curves = [
        rrb.TimeSeriesView(
            origin=name, name=title, plot_legend=rrb.PlotLegend(visible=name in WITH_LEGEND)
        )
        for name, title in CURVES.items()
    ]
    images = [
        rrb.Spatial2DView(origin=side, name=f"{side} events and tracks")
        for side in ("left", "right")
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(origin="world", name="path, 3 sigma, landmarks"),
                rrb.Horizontal(*images),
                row_shares=[3, 2],
            ),
            rrb.Vertical(*curves),
            column_shares=[3, 2],
        ),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
    )
