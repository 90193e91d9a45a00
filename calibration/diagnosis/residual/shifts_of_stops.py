"""Shifts of the tool from stop to stop, which estimated non-repeatability of an axis contains, against functions.

An axis that does not repeat shifts each stop by itself. An unknown error along this axis, a function of positions and
time, shifts them too: it looks like non-repeatability to a fit of its variance, and beside that variance the rows of a
stop hardly show it.
"""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.residual.dependence import Unexplained, explaining_variables
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from kinematics.state import TIME
from kinematics.transforms import Array

SEED = 1
UM = 1e3
CERTAIN = 0.005
"""Chance of a function in shifts without one: that of non-repeatability is the usual explanation."""


def function_of_stops(linearised: LinearisedFit, variables: dict[str, Array]) -> Unexplained | None:
    """The smooth function of variables `(n,)` that explains the shifts of the stops, its shape in mm at the rows.

    The shape `(n, d)` is in the frame of the observations. None where no non-repeatability was estimated, and where the
    shifts do not depend on the variables.
    """
    noise = linearised.measurement.noise
    if noise is None or not noise.non_repeatability or linearised.measurement.components < 3:
        return None
    _, first, stop = np.unique(linearised.measurement.stops[linearised.rows], return_index=True, return_inverse=True)
    arms, shifts = _shifts(linearised, stop)
    at_stops = {name: values[first] for name, values in variables.items()}
    found = explaining_variables(shifts, at_stops, np.random.default_rng(SEED), short=TIME)
    if found is None or found.p_value > CERTAIN:
        return None
    shape = (arms @ found.shape[stop][:, :, None])[:, :, 0] / UM
    return found._replace(shape=np.asarray(shape))


def _shifts(linearised: LinearisedFit, stop: np.ndarray) -> tuple[Array, Array]:
    """Derivatives `(n, d, 3)` by a shift of the tool, and the shift `(stops, 3)`, um, that the rows of each stop show.

    stop: its number `(n,)` for each row.
    """
    first = 6 * len(linearised.measurement.machine.axes)
    white, moved = linearised.white, linearised.transform[:, :, first : first + 3]
    residual = (white @ linearised.in_lengths(linearised.residual)[:, :, None])[:, :, 0]
    information = np.zeros((int(stop.max()) + 1, 3, 3))
    along = np.zeros((len(information), 3))
    np.add.at(information, stop, np.swapaxes(moved, 1, 2) @ moved)
    np.add.at(along, stop, np.einsum("ndk,nd->nk", moved, residual))
    shifts = np.linalg.solve(information, along[:, :, None])[:, :, 0]
    return np.asarray(np.linalg.solve(white, moved)), np.asarray(UM * shifts)
