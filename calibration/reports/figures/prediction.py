"""The figure of a prediction: the deviations in the volume."""

from __future__ import annotations

import numpy as np

from calibration.fit.prediction import Prediction
from kinematics.forward import tool_point
from rendering.figures import Figure, Panel, colour_axis, some
from rendering.volume import cones

DRAWN = 600
"""Most rows that are drawn."""


def prediction_figure(prediction: Prediction) -> Figure:
    """Deviations of some of the rows as cones at their tool points."""
    deviation = prediction.deviation_um
    rows = some(np.arange(len(deviation)), DRAWN)
    points = tool_point(prediction.machine, prediction.state.positions[rows], prediction.tool[rows])
    panel = Panel("x, mm", "y, mm", z="z, mm", kind="scene", traces=[cones(points, deviation[rows])])
    most = float(np.linalg.norm(deviation[rows], axis=1).max(initial=0.0))
    return Figure([panel], height=520, colours=colour_axis(0.0, most or 1.0, "deviation, um"))
