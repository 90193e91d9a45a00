"""Entries of the configuration of controls: where they are, what states them here, and what they change.

One table: `docs/make/configuration.py` writes it into the page of machine files, and `tests/test_configuration.py` runs
every entry with every value through the reading of a program. An entry of `Control` and `Axis` that is not here is
found by that test.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

Ends = tuple[float, ...]


class Trial(NamedTuple):
    """A program that shows what an entry changes."""

    dialect: str
    text: str
    ends: Mapping[str, Ends | str]
    """By the value, as in a machine file: where X Y Z C of the machine stand at the end, mm and degrees, or the reason
    of the refusal."""


class ConfigurationEntry(NamedTuple):
    """One entry of the configuration of a control."""

    control: str
    """Where it is on the control."""
    here: str
    """Where it is stated here: an entry of `[control]`, `rollover` of an axis, an option; empty for none."""
    shown: str
    """The same for a reader."""
    reading: str
    """What it changes for reading and correcting a program."""
    export: str
    """What it changes for an exported or imported table."""
    trial: Trial | None = None


HEAD, KLARTEXT, END = "G21 G90 G17\nG0 X0. Y0. Z0.\n", "BEGIN PGM A MM\nTOOL CALL 1 Z S100\n", "END PGM A MM\n"


def _iso(blocks: str, ends: Mapping[str, Ends | str]) -> Trial:
    return Trial("iso", f"{HEAD}{blocks}\nM2\n", ends)


def _klartext(blocks: str, ends: Mapping[str, Ends | str]) -> Trial:
    return Trial("heidenhain", f"{KLARTEXT}{blocks}\n{END}", ends)


_ROTARY = _iso(
    "G0 C170.\nC340.\nC5.",
    {'"as-written"': (0, 0, 0, 5), '"shortest"': (0, 0, 0, 365), '"signed"': (0, 0, 0, 365)},
)
CONFIGURATION = (
    ConfigurationEntry(
        "LinuxCNC `[AXIS_C] WRAPPED_ROTARY = 1`", "rollover", '`rollover = "signed"`',
        "the sign of a rotary word is the direction", "none", _ROTARY,
    ),
    ConfigurationEntry(
        "FANUC 1008 #0, #1", "rollover", "`rollover`", "way of a rotary word, see above", "none", _ROTARY,
    ),
    ConfigurationEntry(
        "Siemens MD30455 bit 2, Klartext `M126`", "rollover", '`rollover = "shortest"`',
        "the same; `DC()` and `M126` state it in the program", "none",
        _ROTARY._replace(dialect="siemens", text="G71 G90 G17\nG0 X0 Y0 Z0\nG0 C170\nC340\nC5\nM30\n"),
    ),
    ConfigurationEntry(
        "LinuxCNC `[TRAJ] LINEAR_UNITS`, `ANGULAR_UNITS`", "unit", "`unit`; read from the INI file",
        "unit of the tool table, and of programs before `G20` or `G21`",
        "units of compensation files and of kinematic parameters",
        Trial("iso", "G90 G17\nG0 X1. Y0. Z0.\nM2\n", {'"mm"': (1, 0, 0, 0), '"inch"': (25.4, 0, 0, 0)}),
    ),
    ConfigurationEntry(
        "LinuxCNC `[KINS] KINEMATICS = trivkins coordinates=XYYZ`", "--set joints",
        "`--set joints=XYYZ`, or the INI file", "none: programs name axes",
        "one file of a joint for each letter; a letter that comes twice gets its file twice",
    ),
    ConfigurationEntry(
        "LinuxCNC `[EMCIO] RANDOM_TOOLCHANGER`", "random_toolchanger", "`random_toolchanger`", "`G43 H0`, tool 0",
        "none",
    ),
    ConfigurationEntry(
        "LinuxCNC kinematics module (`xyzac-trt-kins`)", "tcp_at_start", "`tcp_at_start`", "X Y Z are the tool point",
        "kinematic parameters of the module",
        # the table has turned by 90 degrees: X10 on it is Y10 of the machine, seen from the tool against the turn
        _iso("G0 C90.\nG1 X10. Y0. Z0. F100", {"false": (10, 0, 0, 90), "true": (0, -10, 0, 90)}),
    ),
    ConfigurationEntry(
        "LinuxCNC 2.10: number of the kinematics in `G12.1 P`", "kinematics_types", "`kinematics_types`",
        "what `G12.1 P` and `G13.1` select", "none",
    ),
    ConfigurationEntry(
        "FANUC 3401 #0 (calculator-type input)", "integer_words", "`integer_words`, `increment`",
        "`X10` is 10 mm or 10 increments", "none",
        _iso("G0 X10", {'"units"': (10, 0, 0, 0), '"increments"': (0.01, 0, 0, 0)}),
    ),
    ConfigurationEntry(
        "FANUC 3402 #0, Siemens MD20150", "", "none: write `G0`, `G1`, `G90` into the program", "modes before any code",
        "none",
    ),
    ConfigurationEntry(
        "centres of arcs: `G90.1`, `G91.1` at the start", "arc_centres", "`arc_centres`",
        "I J K of arcs from the start of the arc, or of the coordinates", "none",
        _iso(
            "G0 X10.\nG3 X0. Y10. I0. J0. F100",
            {'"absolute"': (0, 10, 0, 0), '"incremental"': "centre"},
        ),
    ),
    ConfigurationEntry(
        "dialect of ISO code", "family", "`family`", "where controls differ, ncomp reads as this one", "none",
    ),
    ConfigurationEntry("grbl `$13`", "--table-unit", "`--table-unit`", "unit of the answer to `$#`", "none"),
    ConfigurationEntry(
        "Siemens MD10240, `$MN_SCALING_SYSTEM_IS_METRIC`", "unit", "`unit`", "unit before `G70`, `G71` and of tables",
        "unit of compensation tables",
        Trial("siemens", "G90 G17\nG0 X1 Y0 Z0\nM30\n", {'"mm"': (1, 0, 0, 0), '"inch"': (25.4, 0, 0, 0)}),
    ),
    ConfigurationEntry(
        "Siemens MD10760, `$MN_G53_TOOLCORR`", "g53_tool_length", "`g53_tool_length`",
        "tool length in `G53`, `G153`, `SUPA`", "none",
        Trial(
            "siemens", "G71 G90 G17\nT1 D1 M6\nG0 X0 Y0 Z0\nG0 SUPA Z100\nM30\n",
            {'"kept"': (0, 0, 150, 0), '"suppressed"': (0, 0, 100, 0)},
        ),
    ),
    ConfigurationEntry(
        "HEIDENHAIN 7410", "scaled_axes", "`scaled_axes`", "axes that cycle 11 scales", "none",
        _klartext(
            "CYCL DEF 11.0 SCALING\nCYCL DEF 11.1 SCL 2\nL X+1 Y+2 Z+3 R0 FMAX",
            {'"XYZ"': (2, 4, 56, 0), '"XY"': (2, 4, 53, 0)},
        ),
    ),
    ConfigurationEntry(
        "HEIDENHAIN: repeats that are not whole", "repeats", "`repeats`", "`CALL LBL REP` with a fraction", "none",
        _klartext(
            "Q1 = 2.6\nL X+0 Y+0 Z+0 R0 FMAX\nLBL 1\nL IX+1 R0 FMAX\nCALL LBL 1 REP Q1",
            {'"truncate"': (3, 0, 50, 0), '"round"': (4, 0, 50, 0)},
        ),
    ),
    ConfigurationEntry(
        "block-skip switch, `[DISPLAY]` or panel", "block_skip", "`block_skip`, `--block-skip`", "blocks with a slash",
        "none",
        _iso("/ G0 X5.", {'"on"': (0, 0, 0, 0), '"off"': (5, 0, 0, 0), '""': "block-skip switch"}),
    ),
)  # fmt: skip
"""All entries, as the page shows them."""
CHOICES = {
    "tool_change_moves", "passive_axes", "calls_leave_state", "start", "probing", "klartext_arcs", "pass_through",
    "rotary_feed", "increment",
}  # fmt: skip
"""Entries of `[control]` that are choices of the user, or belong to another entry."""
