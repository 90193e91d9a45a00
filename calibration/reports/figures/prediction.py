"""The figure of a prediction: the deviations in the volume."""

from __future__ import annotations

import numpy as np

from calibration.fit.prediction import Prediction
from kinematics.forward import tool_point
from kinematics.transforms import Array
from rendering.figures import SCENE_HEIGHT_PX, Figure, Panel, Trace, colour_axis, some

DRAWN_ROWS = 600
"""Most rows that are drawn."""
LONGEST_CONE = 0.18
"""Length of the longest cone, as a share of the longest side of the volume."""


def prediction_figure(prediction: Prediction) -> Figure:
    """Deviations of some of the rows as cones at their tool points."""
    deviation = prediction.deviation_um
    rows = some(np.arange(len(deviation)), DRAWN_ROWS)
    points = tool_point(prediction.machine, prediction.state.positions[rows], prediction.tool[rows])
    panel = Panel("x, mm", "y, mm", z="z, mm", kind="scene", traces=[_cones(points, deviation[rows])])
    most = float(np.linalg.norm(deviation[rows], axis=1).max(initial=0.0))
    return Figure([panel], height=SCENE_HEIGHT_PX, colours=colour_axis(0.0, most or 1.0, "deviation, um"))


def _cones(points: Array, vectors: Array) -> Trace:
    """Deviations `(n, 3)`, um, at points `(n, 3)`, mm."""
    (x, y, z), (u, v, w) = points.T, vectors.T
    hover = "x %{x:.0f}, y %{y:.0f}, z %{z:.0f} mm<br>%{u:.2f}, %{v:.2f}, %{w:.2f} um<br>%{norm:.2f} um<extra></extra>"
    trace = {"type": "cone", "x": x, "y": y, "z": z, "u": u, "v": v, "w": w, "coloraxis": "coloraxis"}
    most, extent = (
        float(np.linalg.norm(vectors, axis=1).max(initial=0.0)),
        float(np.ptp(points, axis=0).max(initial=0.0)),
    )
    size = LONGEST_CONE * extent / most if most and extent else 1.0
    return trace | {"hovertemplate": hover, "anchor": "tail", "sizemode": "raw", "sizeref": size}
