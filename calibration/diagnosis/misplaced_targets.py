"""Targets that are not at their stated position, as causes: they are found before the search, which they mislead."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calibration.diagnosis.verdict import Alternative, Named
from calibration.fit.fit import Fit
from calibration.fit.set_up.target_positions import TargetPosition
from kinematics.effects import TargetOffset

KIND = "target-offset"


def misplaced_targets(found: Sequence[TargetPosition], fit: Fit) -> list[Named]:
    """The targets that a fit has at other positions than stated, as causes.

    Their share and the change of the RMS are those of a shift of the rows of the target against all others.
    """
    causes = []
    measurement = fit.measurement
    for each in found:
        if not each.stated:
            continue
        offset_um, u_um = 1e3 * each.offset, 1e3 * each.u
        own = measurement.target_number[fit.kept] == list(measurement.targets).index(each.name)
        squares = float(own.mean() * (1.0 - own.mean()) * np.sum(offset_um**2)) / fit.residual.shape[1]
        x, y, z = offset_um.tolist()
        causes.append(
            Named(
                KIND,
                TargetOffset(each.name, (x, y, z), u=tuple(u_um.tolist())),
                3.0 * math.log(max(fit.observations, 2)) - each.gain,
                math.sqrt(fit.rms_um**2 + squares) - fit.rms_um,
                squares / (squares + fit.rms_um**2),
                "tied" if each.others else "strong",
                1.0,
                tuple(Alternative(KIND, other, f"{KIND} {other}", 1.0, 1.0) for other in each.others),
                (each.text,),
            )
        )
    return causes
