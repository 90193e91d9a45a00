"""The report of a calibration: parameters with uncertainties, residuals, and unidentifiable effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calibration.fit.calibrate import Calibration
from calibration.fit.datum import error_motions
from calibration.fit.fit import Fit
from calibration.observation.equations import covariance
from calibration.observation.normal_equations import whitened, whiteners
from calibration.pages import Section, Table, figure, page
from kinematics.basis import Basis
from kinematics.effects import Effect, ErrorMotion, LocationError
from kinematics.transforms import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#3465a4", "#cc5500", "#4e9a06")
MANY = 4000
"""Most points that are drawn of one kind."""


def fit_page(found: Calibration, command: str) -> bytes:
    """The report as one HTML file; `command` is the command that made it."""
    measurement = found.fit.measurement
    title = f"Calibration of {measurement.machine.name}"
    lead = f"{measurement.source} · {found.model.provenance.made_at:%Y-%m-%d %H:%M} UTC · {command}"
    return page(title, lead, list(_sections(found)))


def _sections(found: Calibration) -> Iterator[Section]:
    fitted, seen = found.fit, found.identifiability
    yield Section("Residual", _verdict(fitted), _residual_table(found))
    locations = [effect for effect in found.model.effects if isinstance(effect, LocationError)]
    if locations:
        rows = [
            (e.name, f"{e.value:.2f}", f"{2 * e.uncertainties[0]:.2f}", "urad" if e.angular else "um")
            for e in locations
        ]
        text = "Tool relative to workpiece, right-handed; of a table the line lies at minus the value."
        yield Section("Location errors", text, Table(("", "value", "U (k=2)", ""), rows))
    others = [e for e in found.model.effects if not isinstance(e, (ErrorMotion, LocationError))]
    if others:
        yield Section("Other effects", table=_effect_table(others))
    yield Section(
        "Error motions",
        "Means and slopes that belong to location errors are taken out. Band: U (k=2).",
        figure=_motions(found),
    )
    yield Section(
        "What is left", "Residuals in standard uncertainties; noise alone is the curve.", figure=_left(fitted)
    )
    yield Section(
        "What is left, along each axis", "Nothing but noise is without shape here.", figure=_along_axes(fitted)
    )
    if seen.unidentifiable:
        hidden = [
            (" + ".join(unidentifiable.effects), unidentifiable.reason, unidentifiable.remedy)
            for unidentifiable in seen.unidentifiable
        ]
        yield Section("Not visible in these data", table=Table(("effect", "how", "what would show it"), hidden))
    left_out = list(_left_out(fitted))
    if left_out:
        yield Section("Left out", table=Table(("row", "why", "from the rest, um"), left_out))


def _verdict(fitted: Fit) -> str:
    text = f"chi2/dof {fitted.chi2_reduced:.3g} by the instrument's sheet, p = {fitted.p_value:.2g}."
    if fitted.variance_factor != 1.0:
        return f"{text} The noise was estimated from the data: {fitted.variance_factor**0.5:.3g} times the sheet."
    if fitted.doubtful:
        return f"{text} The model lacks something, or the sheet promises too much: uncertainties are widened."
    return f"{text} The model explains the data down to the noise."


def _residual_table(found: Calibration) -> Table:
    fitted, seen, held = found.fit, found.identifiability, found.cross_validation
    rows = [
        ("before (nominal machine)", f"{found.before_rms_um:.2f}", f"{found.before_max_um:.2f}"),
        ("after", f"{fitted.rms_um:.2f}", f"{fitted.max_um:.2f}"),
    ]
    if held is not None:
        rows.append((f"held out ({held.blocks} {held.what})", f"{held.rms_um:.2f}", f"{held.max_um:.2f}"))
    rows += [
        ("observations", str(fitted.observations), ""),
        ("parameters (rank)", f"{seen.parameters} ({seen.rank_registered})", ""),
    ]
    return Table(("um", "RMS", "max"), rows)


def _location_table(locations: Sequence[LocationError]) -> Table:
    units = ["urad" if effect.angular else "um" for effect in locations]
    rows = [
        (effect.name, f"{effect.value:.2f}", f"{2 * effect.uncertainties[0]:.2f}", unit)
        for effect, unit in zip(locations, units, strict=True)
    ]
    return Table(("", "value", "U (k=2)", ""), rows)


def _effect_table(effects: Sequence[Effect]) -> Table:
    rows = [
        (effect.name, parameter.name, f"{value:.3f}", f"{2 * u:.3f}", parameter.unit)
        for effect in effects
        for parameter, value, u in zip(effect.parameter_table, effect.parameters, effect.uncertainties, strict=True)
    ]
    return Table(("", "", "value", "U (k=2)", ""), rows)


def _motions(found: Calibration) -> str:
    """The error motions with their uncertainties, one row per axis."""
    model = found.model
    whole = np.array(model.covariance)
    by_axis: dict[str, list[tuple[ErrorMotion, Array]]] = {}
    for effect, part in error_motions(model):
        by_axis.setdefault(effect.axis, []).append((effect, whole[part, part]))
    across = max(len(motions) for motions in by_axis.values())
    with figure(1.9 * max(across, 2), 1.7 * len(by_axis)) as (canvas, drawn):
        grid = canvas.subplots(len(by_axis), across, squeeze=False)
        for row, motions in zip(grid, by_axis.values(), strict=True):
            for place, (effect, own) in zip(row, motions, strict=False):
                _motion(place, effect, own)
            for place in row[len(motions) :]:
                place.set_axis_off()
    return drawn[0]


def _motion(place: Axes, effect: ErrorMotion, own: Array) -> None:
    x, columns = _course(effect.basis)
    value = columns @ effect.parameters
    u = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", columns, own, columns), 0.0))
    place.fill_between(x, value - 2 * u, value + 2 * u, color=COLOURS[0], alpha=0.2, linewidth=0)
    place.plot(x, value, color=COLOURS[0], linewidth=1)
    place.set_title(f"{effect.name}, {'urad' if effect.angular else 'um'}")


def _course(basis: Basis) -> tuple[Array, Array]:
    x = np.linspace(*basis.interval, 200)
    return x, basis.columns(x)


def _left(fitted: Fit) -> str:
    """Distribution of the whitened residuals, and the residuals in the order of acquisition."""
    measurement = fitted.measurement
    white = whitened(whiteners(measurement), fitted.residual)[fitted.kept] / fitted.variance_factor**0.5
    with figure(8.0, 2.4) as (canvas, drawn):
        left, right = canvas.subplots(1, 2)
        edges = np.linspace(-5, 5, 51)
        left.hist(white.reshape(-1), edges, density=True, color=COLOURS[0], alpha=0.5)
        left.plot(edges, np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi), color="#222", linewidth=1)
        left.set_xlabel("residual / standard uncertainty")
        rows = _some(len(white))
        for k in range(white.shape[1]):
            right.plot(
                np.flatnonzero(fitted.kept)[rows], white[rows, k], ".", markersize=2, color=COLOURS[k], rasterized=True
            )
        right.set_xlabel("row, in the order of acquisition")
    return drawn[0]


def _along_axes(fitted: Fit) -> str:
    """Residuals over the position of each axis that moves."""
    measurement = fitted.measurement
    machine = measurement.machine
    positions = measurement.state.positions[fitted.kept] / machine.scale
    moving = [i for i in range(len(machine.axes)) if np.ptp(positions[:, i]) > 0]
    residual = (fitted.residual * measurement.per_micro)[fitted.kept]
    noise = np.sqrt(np.diagonal(covariance(measurement), axis1=1, axis2=2)) * measurement.per_micro
    typical = noise[fitted.kept].mean(axis=0)
    rows = _some(len(residual))
    with figure(2.7 * max(len(moving), 2), 2.2) as (canvas, drawn):
        for place, i in zip(canvas.subplots(1, len(moving), squeeze=False)[0], moving, strict=True):
            for k in range(residual.shape[1]):
                name = "xyz"[k] if residual.shape[1] > 1 else None
                place.plot(
                    positions[rows, i],
                    residual[rows, k],
                    ".",
                    markersize=2,
                    color=COLOURS[k],
                    label=name,
                    rasterized=True,
                )
            place.axhline(2 * typical.max(), color="#888", linewidth=0.6)
            place.axhline(-2 * typical.max(), color="#888", linewidth=0.6)
            place.set_xlabel(f"{machine.axes[i].name}, {machine.axes[i].unit}")
            place.set_ylabel("residual, um")
            if residual.shape[1] > 1:
                place.legend(loc="upper right", markerscale=3, frameon=False)
    return drawn[0]


def _points(place: Axes, x: Array, y: Array, component: int) -> None:
    place.plot(x, y, ".", markersize=2, color=COLOURS[component], label="xyz"[component], rasterized=True)


def _left_out(fitted: Fit) -> Iterator[Sequence[str]]:
    size = fitted.residual_um
    reasons = (("outlier", fitted.outliers), ("copy of an earlier row", np.flatnonzero(fitted.copies)))
    for why, rows in reasons:
        for row in rows[:50].tolist():
            yield fitted.measurement.where(row), why, f"{size[row]:.1f}"
        if len(rows) > 50:
            yield f"... {len(rows) - 50} more", why, ""
    for station in fitted.failed:
        yield f"station {station}", "most of its rows disagree with all others", ""


def _some(n: int) -> np.ndarray:
    return np.linspace(0, n - 1, min(n, MANY)).astype(int)
