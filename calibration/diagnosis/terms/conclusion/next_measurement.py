"""The recommended next measurement, as text for the workshop."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.diagnosis.terms.conclusion.cause import Cause
from calibration.diagnosis.terms.conclusion.verdict import Judged


def next_measurement(causes: Sequence[Cause], unexplained: Sequence[Judged]) -> str:
    """What tells a tied cause from others, finds an open period, or shows a function again; else a check."""
    tied = next((cause for cause in causes if cause.verdict == "tied"), None)
    if tied is not None:
        others = " or ".join(each.name for each in tied.alternatives)
        return f"To tell {tied.effect.name} from {others}, measure {tied.effect.SHOWN_BY}."
    wave = next((each for each in unexplained if each.periods), None)
    if wave is not None:
        axis = wave.term.where
        return f"To find the period of a wave along {axis}, measure {axis} in irregular, finer steps."
    if unexplained:
        names = ", ".join(dict.fromkeys(variable for each in unexplained for variable in each.variables))
        return (
            f"An error depends on {names}. Repeat the measurement with its positions in another order: this shows "
            "whether the error recurs with the position or with the time."
        )
    return "Correct a program with the new calibration, and measure the same positions again."
