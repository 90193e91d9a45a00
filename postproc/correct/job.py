"""What one correction is given: a program, its machine with errors, and the options of the user."""

from __future__ import annotations

import msgspec

from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD
from postproc.control.setup import Setup
from postproc.correct.plausibility import REASONS
from postproc.dialects import Dialect
from postproc.text.source import Source


class Job(msgspec.Struct, frozen=True):
    """One program to be corrected for one machine."""

    source: Source
    dialect: Dialect
    machine: Machine
    model: ErrorModel
    setup: Setup
    travel_check: bool = True
    force: bool = False
    classes: frozenset[str] | None = None
    """Elementary compensation classes, and FOR, that are corrected; None for all but FOR."""
    tolerance_um: float = 1.0
    """Largest deviation of a feed move between its ends, um, without splitting; half of it is no reversal."""
    conditions: Conditions = COLD
    """Conditions during the run of the program."""
    max_correction_um: float | None = None
    """Largest correction of a linear axis, um; None for the default of `CorrectionLimit`."""
    accepted: frozenset[str] = frozenset(REASONS)
    """Names of implausible conditions that are accepted; the command line accepts none by default."""
    rotary_feed: str = "leave"
    """Treatment of feed moves of rotary axes alone, see `Control.rotary_feed`."""
    leave_outside: bool = False
    """True if moves outside the range of the calibration stay as programmed."""
    unroll: bool = False
    """True if loops and calls are written out."""
    beside: bool = False
    """True if the files of called programs are corrected as files; otherwise their blocks are written out."""
    shared: frozenset[str] = frozenset()
    """Files of called programs that other programs call too: if they need a correction, their blocks are written out.
    """
    tcp: str = ""
    """`to-axes`: the tool point's coordinates become positions of the axes; `to-tcp`: the reverse; empty: neither."""
    tcp_feed: str = ""
    """Feed of converted moves: `inverse-time` or `scaled`; empty: the default of the dialect."""
