"""A program without a length offset needs no tool length where no error is a rotation."""

import pytest
from support.command import refusal, succeed
from support.effect_examples import EXAMPLES, deviation_of, full_state
from support.machine_texts import machine_text
from support.programs import model_of

import ncomp
from kinematics.effects import LocationError
from kinematics.error_model.model import write_model

FILE = machine_text(more="[work_offsets]\nG54 = { X = 0, Y = 0, Z = 0 }\n")
WITHOUT, WITH = "M6 T102\nG0 X10. Y10. Z20.\n", "M6 T102\nG43 H102\nG0 X10. Y10. Z20.\n"


@pytest.fixture
def run(tmp_path):
    """Writes machine, calibration and program; returns the arguments of a command."""

    def arguments(text, *effects):
        (tmp_path / "mill.toml").write_text(FILE)
        machine = ncomp.load_machine(str(tmp_path / "mill.toml"))
        write_model(model_of(machine, *effects), tmp_path / "cal.json")
        (tmp_path / "a.nc").write_text(f"G21 G90 G17 G54\n{text}G1 Z-1. F100\nX50.\nM30\n")
        return tmp_path / "a.nc", "--machine", tmp_path / "mill.toml", "--calibration", tmp_path / "cal.json"

    return arguments


def test_shifts_need_no_length(run, tmp_path):
    command = (*run(WITHOUT, LocationError("X", "X", 20.0)), "--accept", "insignificant")
    assert "20.00 -> 0.00" in succeed(*command, "-o", tmp_path / "out.nc").shown or (tmp_path / "out.nc").exists()
    succeed("verify", command[0], tmp_path / "out.nc", *command[1:5])


def test_rotations_and_length_offsets_need_it(run, tmp_path):
    out = ("-o", tmp_path / "out.nc")
    said = refusal(*run(WITHOUT, LocationError("B", "X", 20.0)), *out)
    assert "length of tool T102 is not given" in said
    said = refusal(*run(WITH, LocationError("X", "X", 20.0)), *out)
    assert "length of tool T102 is not given" in said
    succeed(*run(WITHOUT, LocationError("B", "X", 20.0)), "--tool-length", "T102=50", "--accept", "insignificant", *out)


OF_MACHINE = [example for example in EXAMPLES if example.effect.ACTS_ON != "instrument"]


@pytest.mark.parametrize("example", OF_MACHINE, ids=lambda example: example.name)
def test_other_errors_do_not_depend_on_the_tool(example):
    machine = example.machine
    near, far = (
        deviation_of(example.effect, machine, full_state(machine, 20), (0.0, 0.0, z)).position for z in (0.0, -300.0)
    )
    if not example.effect.angular:
        assert near == pytest.approx(far, abs=1e-9)
