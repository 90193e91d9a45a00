"""Targets that are not at their stated position, as causes: they are found before the search, which they mislead.

A cause that the search finds may have moved them: they are causes only if they are misplaced beside all causes too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.verdict import Alternative, Named
from calibration.fit.fit import Fit
from calibration.fit.set_up.target_positions import LEAST_UM, TargetPosition, significant
from kinematics.effects import TargetOffset

KIND = "target-offset"


def beside_causes(found: Sequence[TargetPosition], result: LinearisedFit) -> list[TargetPosition]:
    """The positions as the fit with all causes has them, without stated ones from which it does not differ clearly.

    result: with the function of an unexplained residual, if any: it may have moved them too.
    """
    fit = result.fit
    left = []
    for each in found:
        if not each.stated or each.runout:
            left.append(each)
            continue
        stated = np.array(fit.measurement.targets[each.name].position) - each.offset
        offset = fit.registration.targets[each.name] - stated
        own = [k for k, name in enumerate(fit.registration.names) if name.startswith(f"target {each.name} ")]
        others = replace(
            result,
            design=np.delete(result.design, own, axis=1),
            limited=np.delete(result.limited, own),
            away=np.delete(result.away, own),
        )
        effect = TargetOffset(each.name, (0.0, 0.0, 0.0))
        mm = 1e-3 * np.array([quantity.typical for quantity in effect.parameter_table])
        information = others.projected(others.columns(effect)).schur / np.outer(mm, mm)
        gain = float(offset @ information @ offset)
        if significant(gain, len(fit.measurement.targets)) and 1e3 * np.linalg.norm(offset) >= LEAST_UM:
            u = np.sqrt(np.diag(np.linalg.pinv(information)))
            left.append(replace(each, offset=offset, u=u, gain=gain))
    return left


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
