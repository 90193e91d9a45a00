"""The correction: commanded positions whose actual poses, by the error model, are the nominal poses."""

from __future__ import annotations

from functools import cached_property

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from kinematics.columns import ChainColumns, Vector, length, minus, rows_of, vector
from kinematics.correction import LAST_CORRECTION_STEP, Uncorrected, correct_orientation, correct_position
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions, States
from postproc.compensation.datum import datum_shifts
from postproc.motion.along import positions_along
from postproc.motion.circles import middle_share
from postproc.motion.motions import Motions

COLD = Conditions()
"""Conditions for an error model that depends on positions alone."""
AT_REST = COLD.states()


class Correction(msgspec.Struct, frozen=True):
    """Corrected positions of a chunk of moves; positions `(n, axes)` in programmed coordinates, mm and degrees."""

    nominal: Array
    """Nominal axis positions `(n, axes)`, mm and rad."""
    corrected: Array
    """Corrected axis positions `(n, axes)`, mm and rad."""
    target: Array
    """Corrected programmed positions."""
    middle_shift: dict[int, Array]
    """Corrected minus nominal programmed position `(axes,)` in the middle of an arc, by row."""
    before: PoseErrors | None = None
    """Errors at the nominal positions; None if the orientation is corrected as well."""


def correct(
    motions: Motions,
    model: ErrorModel,
    orientation: ErrorModel | None = None,
    conditions: Conditions = COLD,
    approach: Array | None = None,
) -> Correction:
    """Correct all moves of a chunk: end points, and the middles of arcs.

    Linear axes with a position programmed in the present frame get the correction of the tool point by `model`. With
    a model for the orientation, rotary axes get the correction of the tool axis. All other axes keep the nominal
    position. The target is on the part at its actual position: it includes the shift of a work offset that was touched
    off on the machine, by `model`. approach `(n, axes)`: direction of each axis at the end of each move.
    """
    ends = correct_ends(motions, model, orientation, conditions, approach)
    rows = sorted(motions.arcs)
    states = conditions.states(None if approach is None else approach[rows])
    shift = datum_shifts(motions, model, conditions)
    return replace(ends, middle_shift=_arc_middles(motions, (model, orientation), states, rows, shift))


def correct_ends(
    motions: Motions,
    model: ErrorModel,
    orientation: ErrorModel | None = None,
    conditions: Conditions = COLD,
    approach: Array | None = None,
    precision: float = LAST_CORRECTION_STEP,
) -> Correction:
    """The correction of the end points alone. precision: that of `correct_position`."""
    nominal, states = motions.machine_target, conditions.states(approach)
    machine, tool, shift = motions.machine, motions.tool, datum_shifts(motions, model, conditions)
    before = pose_errors(machine, model, nominal, nominal, tool, states, shift) if orientation is None else None
    corrected = corrected_positions(
        machine, (model, orientation), states, nominal, tool, motions.movable, shift, precision, before, motions
    )
    return Correction(nominal, corrected, motions.in_program(corrected), {}, before)


def corrected_positions(
    machine: Machine,
    models: tuple[ErrorModel, ErrorModel | None],
    states: States,
    nominal: Array,
    tool: Array,
    movable: NDArrayBool,
    shift: ArrayLike = (0.0, 0.0, 0.0),
    precision: float = LAST_CORRECTION_STEP,
    before: PoseErrors | None = None,
    written: Motions | None = None,
) -> Array:
    """Axis positions `(n, axes)`, mm and rad, with the actual pose equal to the nominal pose at `nominal` `(n, axes)`.

    models: of the tool point and, for movable rotary axes, of the orientation. tool `(n, 3)`, mm. shift `(n, 3)`, mm,
    workpiece frame: displacement of the part from its nominal position. precision: as of `correct_position`. before:
    errors at `nominal`, if the caller has them, and if the orientation is not corrected. written: the moves whose words
    give the positions; corrected rotary axes then take positions that can be written, and linear axes fit these.
    """

    model, orientation = models
    start = None
    if orientation is not None:
        start = correct_orientation(machine, states.errors(machine, orientation), nominal, movable)
        if written is not None:
            for i in np.flatnonzero(machine.rotary).tolist():
                start[:, i] = np.where(movable[:, i], written.as_written(start[:, i], i), start[:, i])
    errors, slope = states.errors(machine, model), states.conditions.errors(machine, model).slope
    known = None if before is None else Uncorrected(before.actual, before.there, before.reached)
    return correct_position(machine, errors, nominal, tool, movable, start, shift, precision, slope, known)


class PoseErrors(msgspec.Struct, frozen=True, dict=True):
    """Errors at n axis positions of a machine with errors, against nominal poses."""

    actual: ChainColumns
    aim: ChainColumns
    errors: Array
    """Error motions `(n, axes + 1, 6)`, mm and rad."""
    there: Vector
    """Nominal tool points, mm, workpiece frame."""
    reached: Vector
    """Actual tool points, likewise."""
    shift: Vector
    """Displacement of the part from its nominal position, mm, workpiece frame."""

    @property
    def nominal_pose(self) -> tuple[ChainColumns, Vector]:
        """As an argument of `pose_errors` at other positions, against the same nominal poses."""
        return self.aim, self.there

    @cached_property
    def _away(self) -> Vector:
        return minus(self.reached, self.there)

    @cached_property
    def point_um(self) -> Array:
        """Error relative to the datum `(n,)`, um: distance from the nominal tool point on the part at its actual
        position."""
        return length(minus(self._away, self.shift)) * 1e3

    @cached_property
    def absolute_um(self) -> Array:
        """Absolute error `(n,)`, um: distance from the nominal tool point of the true work offset."""
        return length(self._away) * 1e3

    @cached_property
    def nominal(self) -> Array:
        """Nominal tool points `(n, 3)`, mm, workpiece frame."""
        return rows_of(self.there, len(self.errors))

    @cached_property
    def apart(self) -> Array:
        """The absolute error as a vector `(n, 3)`, mm."""
        return rows_of(self._away, len(self.errors))

    @cached_property
    def axis_urad(self) -> Array:
        """Angle of the tool axis `(n,)`, urad."""
        return length(minus(self.actual.tool_axis(self.errors), self.aim.nominal_tool_axis)) * 1e6


def pose_errors(
    machine: Machine,
    model: ErrorModel,
    q: Array,
    nominal: Array,
    tool: Array,
    states: States = AT_REST,
    shift: ArrayLike = (0.0, 0.0, 0.0),
    nominal_pose: tuple[ChainColumns, Vector] | None = None,
) -> PoseErrors:
    """Pose errors of the machine at `q` against the nominal pose at `nominal`, both `(n, axes)`, mm and rad.

    By the exact model. tool `(n, 3)`, mm. shift `(n, 3)`, mm, workpiece frame: displacement of the part from
    its nominal position (`datum_shifts`). nominal_pose: the machine at `nominal` without errors, and its tool points,
    if the caller has them.
    """
    tip, errors = vector(tool), states.errors(machine, model)(q)
    aim = ChainColumns(machine, nominal) if nominal_pose is None else nominal_pose[0]
    there = aim.point(tip) if nominal_pose is None else nominal_pose[1]
    turned_alike = q is nominal or np.array_equal(q[:, machine.rotary], nominal[:, machine.rotary])
    actual = ChainColumns(machine, q, aim if turned_alike else None)
    return PoseErrors(actual, aim, errors, there, actual.point(tip, errors), vector(shift))


def _arc_middles(
    motions: Motions,
    models: tuple[ErrorModel, ErrorModel | None],
    states: States,
    rows: list[int],
    shift: Array,
) -> dict[int, Array]:
    if not rows:
        return {}
    middles = _middles(motions)
    nominal = motions.in_machine(middles)
    corrected = nominal.copy()
    tool = motions.tool[rows]
    corrected[rows] = corrected_positions(
        motions.machine, models, states, nominal[rows], tool, motions.movable[rows], shift[rows]
    )
    moved = motions.in_program(corrected) - middles
    return {row: moved[row] for row in rows}


def _middles(motions: Motions) -> Array:
    """Programmed positions `(n, axes)` in the middle of all moves; on arcs with whole turns, at `middle_share`."""
    middles = motions.along(0.5)
    if motions.arcs:
        circles = motions.circles
        rows = circles.rows[circles.turns > 0]
        shares = np.array([middle_share(turned) for turned in circles.turned[circles.turns > 0].tolist()], float)
        middles[rows] = positions_along(motions, rows, shares)
    return middles
