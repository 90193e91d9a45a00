"""The residual of a diagnosis: before and after, by direction, against the noise, and its unexplained part."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.result import LEFT, Diagnosis
from calibration.diagnosis.unseen.swing import FoundSwing
from calibration.fit.acceptance import ARM, measures_angles
from calibration.reports.diagnosis_json import models_compared
from calibration.reports.figures.residuals import against_noise, before_and_after, by_direction, unexplained_shape
from kinematics.files.number_text import amount, p_value, probability
from rendering.figures import percent
from rendering.report import Section, Table, shortened

PERIODS = 8
"""Most periods that a sentence lists."""
OBSERVED = "Residuals are observed minus expected, in x, y, z of the part that carries the instrument."


def residual_sections(found: Diagnosis) -> Iterator[Section]:
    """The sections from the residual before and after to the unexplained one."""
    rows = [
        (name, f"{f.rms_um:.2f}", f"{f.max_um:.1f}", f"{f.chi2_reduced:.2f}", f"{f.heldout_rms_um:.2f}")
        for name, f in zip(("before", "after"), found.figures, strict=True)
    ]
    rows += [(f"the same rows, {name}", "", "", "", f"{rms:.2f}") for name, rms in models_compared(found)]
    rows.append(("expected of noise alone", f"{found.noise_um:.2f}", "", "1", ""))
    table = Table((f"residual, {found.measurement.unit}", "RMS", "max", "chi2/dof", "held out, RMS"), rows)
    text = (
        f"{OBSERVED} Max is the largest length. Before and after are of the same rows. Held-out residuals are those of "
        f"{found.held_out_name}, each predicted by a fit of all others. The residual after may be a little below that "
        "of noise alone, because the model follows a part of the noise."
    )
    yield Section("Residual before and after", text, table, partial(before_and_after, found))
    before, after = found.by_direction["before"], found.by_direction["after"]
    directions = [(name, f"{before[name]:.2f}", f"{after.get(name, float('nan')):.2f}") for name in before]
    table = Table((f"residual RMS, {found.measurement.unit}", "before", "after"), directions)
    approached = found.measurement.state.approach is not None
    drawn = partial(by_direction, found) if approached else None
    yield Section("By direction, and in the volume", "\n".join(_volume(found)), table, drawn)
    yield Section("Residual against noise", figure=partial(against_noise, found))
    if found.tests:
        text = (
            "Each p is the probability of so large a value under pure noise. A test is marked where all tests together "
            f"leave a probability below {100 * LEFT:.0f} %. The tests along a variable use the correlation of adjacent "
            "rows, the others different means, or a slope."
        )
        yield Section("Tests of the residual", text, _tests(found), detail=True)
    yield _unexplained(found)


def _volume(found: Diagnosis) -> Iterator[str]:
    volume = found.volume
    yield (
        f"Error of the machine over the measured positions, by the new model: {volume.machine_rms:.2f} um RMS, "
        f"{volume.machine_max:.1f} um at most (after the best common shift and rotation{_lever(found)})."
    )
    if found.causes:
        yield (
            f"Error after a correction by the present model, by the new one: {volume.left_rms:.2f} um RMS, "
            f"{volume.left_max:.1f} um at most."
        )
    if found.closure:
        yield f"No error motion of an axis explains {percent(found.closure)} of the residual beyond the noise."


def _lever(found: Diagnosis) -> str:
    """The tool point at which measured angles act."""
    return f"; tool point {ARM:g} mm off in x, y, z" if measures_angles(found.measurement) else ""


def _tests(found: Diagnosis) -> Table:
    after = {test.name: test for test in found.tests_after}
    marked = [{test.name for test in combined(tests, LEFT)} for tests in (found.tests, found.tests_after)]
    rows = [(test.name, *_tested(test, marked[0]), *_tested(after.get(test.name), marked[1])) for test in found.tests]
    return Table(("residuals", "p before", "result before", "p after", "result after"), rows)


def _tested(test: Test | None, marked: set[str]) -> tuple[str, str]:
    return ("", "") if test is None else (p_value(test.p_value), "not noise" if test.name in marked else "noise")


def _unexplained(found: Diagnosis) -> Section:
    left = found.unexplained
    if left is None:
        return Section("Unexplained", f"{found.conclusion.unexplained}{_few_rows(found.widened)}")
    consequences = (
        f"{_of_readings(left)}{_of_any_period(left)}{_swing(found.swing)}{_beside(found)}{_widened(found.widened)}"
    )
    text = (
        f"{amount(found.unexplained_um, found.measurement.unit)} RMS depend on {left.listed} "
        f"({probability(left.p_value, 2)}), and no cause of the library explains them.{consequences}\n"
        "The table tests each variable alone: its squared distance correlation (without bias, about 0 where "
        "independent), and the p-value among residuals permuted in blocks, as it is and adjusted by Benjamini and "
        "Hochberg. Variables that act only jointly are not found.\nThe figure is "
        f"the smooth shape over these variables, {found.measurement.unit}. {OBSERVED}"
    )
    rows = [(o.variable, f"{o.correlation:.3f}", f"{o.p_value:.2g}", f"{o.adjusted:.2g}") for o in found.one_by_one]
    alone = Table(("variable", "distance correlation, squared", "p", "adjusted p"), rows)
    return Section("Unexplained", text, alone, partial(unexplained_shape, found))


def _few_rows(factor: float) -> str:
    if factor == 1.0:
        return ""
    return (
        " The data leave open further causes, other forms of those named or waves of rotary axes, or show errors finer "
        f"than the bases: the uncertainties of the calibration are {factor:.2g} times those that follow from the noise."
    )


def _of_readings(left: Unexplained) -> str:
    if not left.of_readings:
        return ""
    return " A function of the tracker's readings explains them better than an error of the machine does."


def _of_any_period(left: Unexplained) -> str:
    if not left.periods:
        return ""
    axis = left.variables[0]
    listed = shortened([f"{period:.4g}" for period in left.periods], PERIODS, "periods")
    return (
        f" They may be a wave along {axis}, or steps, but the positions of {axis} do not determine its period: "
        f"{', '.join(listed)} {'deg' if axis[0] in 'ABC' else 'mm'} explain them nearly equally. Between the positions "
        f"the error is unknown: measure {axis} at irregular, finer spacing."
    )


def _swing(swing: FoundSwing | None) -> str:
    if swing is None:
        return ""
    by = f", by different amounts along {' and '.join(swing.variables)}" if swing.variables else ""
    period = f"{swing.period:.5g} s +- {2.0 * swing.u:.2g} s (k=2)"
    return (
        f" The error is periodic in time: {swing.component} of the tool swings with a period of {period}{by}. Look for "
        "a cause with this period: the control of the hall's air, of a coolant or an oil, a door, another machine."
    )


def _beside(found: Diagnosis) -> str:
    if not found.beside_function:
        return ""
    return (
        " The new calibration has learned as little of them as possible: it was fitted beside a function of these "
        "variables, which it does not contain. The residuals after are those of the fit without the function."
    )


def _widened(factor: float) -> str:
    if factor == 1.0:
        return ""
    return f" Therefore the uncertainties of the calibration are {factor:.2g} times those that follow from the noise."
