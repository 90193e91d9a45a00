"""Every export, applied to the virtual machine as its control would: the remaining error agrees with sheet.md.

The files are written by the command; the control (`virtual_machine.controls`) shares no code with it. Their values are
read back by the command too, and written a second time.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from support.applied_tables import TOOL, calibration, missed, places, rms, settings
from support.programs import FIVE_AXES, THREE_AXES, load
from support.tiers import each_once, quick
from virtual_machine.calibrated import read_calibration
from virtual_machine.chain import load as chain_of
from virtual_machine.controls import control

from kinematics.error_model.model import read_model
from kinematics.state import State
from postproc.control_data.formats import formats_of
from postproc.control_data.tables.table_format import TableFormat

FORMATS = formats_of(TableFormat)

QUICK = ("linuxcnc",)
"""The formats that the default run applies too; CI applies all."""


class Written(NamedTuple):
    """An export: its machine, its folder, and its JSON results."""

    machine: str
    format: str
    folder: Path
    told: dict


def exported(command, machine, format, source, name, sign="error", *more):
    """`ncomp export` of a calibration file."""
    options = () if FORMATS[format].sign else ("--sign", sign)
    done = command("export", "-m", machine, "--format", format, "-c", source, "-o", name, "--tool-mm", 80,
                   *options, *settings(machine, format), *more, "--json", f"{name}.out.json")  # fmt: skip
    assert done.status == 0, done.err
    return Written(machine, format, Path(name), json.loads(Path(f"{name}.out.json").read_text()))


def imported(command, written, name, sign="error"):
    """`ncomp import` of an export."""
    options = () if FORMATS[written.format].sign else ("--sign", sign)
    done = command("import", written.folder, "-m", written.machine, "--format", written.format, "-o", name,
                   *options, *settings(written.machine, written.format))  # fmt: skip
    assert done.status == 0, done.err
    return read_model(Path(name), load(written.machine))


def check_left(written, source, sign="error"):
    """The remaining error on the control is the predicted one, with and without the zeros shifted."""
    chain, truth = chain_of(written.machine), read_calibration(Path(source))
    moves = control(written.format, written.folder, chain, sign, TOOL)
    told = written.told["errors"]["volume"]["tool_point_um"]
    commands, ways = places(chain)
    shift = np.array([written.told["datum_shift"].get(name, 0.0) for name in chain.names])
    with_tables = moves(commands, ways)
    stages = {"before": commands, "after_tables": with_tables}
    if shift.any():
        stages["after_tables_and_datum_shift"] = with_tables + shift
    assert set(told) - {"after_nc_correction", "after_tables_and_nc_correction_of_the_rest"} == set(stages)
    for stage, motors in stages.items():
        left = missed(chain, truth, motors, commands, ways)
        assert rms(left) == pytest.approx(told[stage]["rms"], rel=0.05, abs=0.02), stage
        assert np.quantile(left, 0.95) == pytest.approx(told[stage]["p95"], rel=0.05, abs=0.03), stage
        assert left.max() < 1.3 * told[stage]["max"] + 0.1, stage


def check_round_trip(command, written, sign="error"):
    """Tables that are read back and written again: both readings remove the same errors."""
    machine = load(written.machine)
    first = imported(command, written, "first.json", sign)
    again = exported(command, written.machine, written.format, "first.json", "again", sign)
    second = imported(command, again, "second.json", sign)
    commands, ways = places(machine)
    state = State(commands * machine.scale, ways)
    errors = [model.errors(machine, state) for model in (first, second)]
    assert np.abs(errors[0]).max() > 1e-3
    assert np.sqrt(np.mean((errors[1] - errors[0]) ** 2)) < 2e-4
    left = again.told["errors"]["volume"]["tool_point_um"]
    assert left["after_tables"]["rms"] < 0.5 + 0.05 * left["before"]["rms"]


@pytest.mark.parametrize(
    "format", [each if each in QUICK else pytest.param(each, marks=pytest.mark.statistical) for each in FORMATS]
)
def test_a_c_frame_is_left_as_the_sheet_says(command, format):
    calibration(load("cframe"), Path("cal.json"))
    check_left(exported(command, "cframe", format, "cal.json", "tables"), "cal.json")


@pytest.mark.statistical
def test_fanuc_by_direction(command):
    """Points of negative travel are others than those of positive travel."""
    calibration(load("cframe"), Path("cal.json"))
    written = exported(command, "cframe", "fanuc", "cal.json", "tables", "correction", "--set", "bidirectional=true")
    assert (written.folder / "pitch.csv").read_text().count(",negative,") > 2
    check_left(written, "cal.json", "correction")


@pytest.mark.usefixtures("few_positions")
def test_the_shift_of_the_zeros_is_told_first(command):
    """Tables that are 0 at the reference position leave more without it than there was."""
    calibration(load("trunnion_ac"), Path("cal.json"))
    done = command("export", "-m", "trunnion_ac", "--format", "mitsubishi", "-c", "cal.json", "-o", "tables")
    assert done.status == 0, done.err
    shown = done.out.decode()
    assert 0 < shown.index("Zero shift: the tables hold no constant") < shown.index("Remaining errors")
    sheet = Path("tables/sheet.md").read_text()
    assert sheet.index("**Zero shift:") < sheet.index("## Meaning of the numbers")


EVERY = [(machine, format) for machine in (*THREE_AXES, *FIVE_AXES) for format in FORMATS]


@pytest.mark.parametrize(("machine", "format"), quick(EVERY, [], each_once([*THREE_AXES, *FIVE_AXES], FORMATS)))
def test_every_machine_is_left_as_the_sheet_says_and_read_again(command, machine, format):
    calibration(load(machine), Path("cal.json"))
    written = exported(command, machine, format, "cal.json", "tables", "correction")
    check_left(written, "cal.json", "correction")
    check_round_trip(command, written, "correction")
