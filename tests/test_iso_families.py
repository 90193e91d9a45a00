"""Constructs of single families of ISO controls: cycles with R above the level, grbl, kinematics of LinuxCNC."""

import dataclasses
import re

import numpy as np
import pytest
from support.called_programs import MODEL
from support.command import refusal
from support.machine_texts import machine_text
from support.programs import correct, load, random_model, read

import ncomp
from kinematics.user_error import UserError

HEAD = "G21 G90 G17 G54 G94\nG0 X10. Y10. Z5.\nG1 X11. F500\n"


def of(family, name="gantry", **entries):
    machine = load(name)
    return dataclasses.replace(machine, control=dataclasses.replace(machine.control, family=family, **entries))


def ends(text, machine, **setup):
    """Where the blocks end, in machine coordinates, mm and degrees."""
    motions = read(HEAD + text + "M2\n", machine, **setup)
    return (motions.machine_target / machine.scale).tolist()[2:]


def refused(text, machine):
    with pytest.raises(UserError) as fault:
        read(HEAD + text + "M2\n", machine)
    return str(fault.value)


# text: Z behind the cycle, by FANUC (back to the level before it) and by LinuxCNC (the higher of level and R)
ABOVE = {
    "G98 G81 X20. Z-3. R7. F100\nG80\n": (5.0, 7.0),
    "G98 G81 X20. Z-3. R7. F100\nX30. R6.\nX40. R3.\nG80\n": (5.0, 5.0),
    "G91 G98 G81 X2. Z-3. R2. F100 L3\nG80\nG90\n": (5.0, 7.0),
    "G91 G99 G81 X2. Z-3. R-1. F100 L3\nX2. R-2. Z-2.\nG80\nG90\n": (3.0, 3.0),
    "G91 G99 G81 X2. Z-3. R2. F100\nG82 X2. Z-3. R1. P0\nG80\nG90\n": (6.0, 6.0),
}


@pytest.mark.parametrize("cycle", ABOVE)
def test_a_cycle_with_r_above_the_level_returns_as_the_control_does(cycle, linuxcnc):
    fanuc, other = ABOVE[cycle]
    text = cycle + "G0 X0.\n"
    assert ends(text, of("fanuc"))[-1] == pytest.approx([0.0, 10.0, fanuc])
    assert ends(text, of("linuxcnc"))[-1] == pytest.approx([0.0, 10.0, other])
    assert list(linuxcnc.run(HEAD + text + "M2\n").moves[-1].machine[:3]) == pytest.approx([0.0, 10.0, other])


@pytest.mark.parametrize("family", ["any", "fanuc"])
def test_drilling_upwards(family):
    """From X-5 past R-3 to the bottom at X10, and back to X-5, where a control drills so at all."""
    text = "G0 X-5. Y-20. Z-20.\nG98 G19 G81 X10. Y-20. Z-20. R-3. F250\nG80 G17\nG0 Y0.\n"
    assert ends(text, of(family))[1:] == [[10.0, -20.0, -20.0], [-5.0, 0.0, -20.0]]
    assert "above its R, which LinuxCNC refuses" in refused(text, of("linuxcnc"))


def test_a_corrected_r_stays_above_the_level(linuxcnc):
    """LinuxCNC returns to the higher of both: written with R below the level it would return elsewhere."""
    machine = of("linuxcnc")
    text = HEAD + "G98 G81 X200. Y300. Z-3. R5.0001 F100\nX400.\nG80\nG0 X0.\nM2\n"
    model = random_model(machine, 4)
    result = correct(text, machine, model, travel_check=False, tolerance_um=1e3)
    moves = linuxcnc.run(result.text).moves
    commanded = read(result.text, machine).machine_target
    assert moves[-1].machine[:3] == pytest.approx(commanded[-1].tolist(), abs=1e-9)
    holes = [move.machine[2] for move in moves if move.kind == "line"][-2:]
    np.testing.assert_allclose(holes, commanded[2:4, 2], atol=1e-9)


def test_the_way_to_a_hole_after_g99_is_at_the_level_as_in_the_program(linuxcnc):
    """LinuxCNC goes to the hole of a G98 at the level before the cycle, unless the tool is above R."""
    machine = of("linuxcnc")
    text = "G0 Z50.\nG99 G81 X47. Y179. Z18. R20. F100\nX25. R48. Z28.\nG98 X24. Y30.\nG80\nG0 X0.\nM2\n"
    result = correct(HEAD + text, machine, MODEL, travel_check=False, tolerance_um=1e3)
    ways = [[move.machine for move in linuxcnc.run(each).moves] for each in (HEAD + text, result.text)]
    assert len(ways[0]) == len(ways[1])
    assert np.abs(np.subtract(*ways)).max() < 0.05


# ---- LinuxCNC


def test_kinematics_by_number():
    """Tool point at C90: X3 of the workpiece is Y3 of the machine, for a table that turns about its origin."""
    machine = of("linuxcnc", "trunnion_bc", kinematics_types=("axes", "tool-point"))
    text = "G0 X0. Y0. Z100. B0. C90.\nG12.1 P1\nG1 X3. Y0. Z100.\nG13.1\nG1 X3. Y0. Z100.\n"
    _, tool_point, axes = ends(text, machine)
    names = machine.names
    assert [tool_point[names.index(axis)] for axis in "XYC"] != [3.0, 0.0, 90.0]
    assert abs(tool_point[names.index("X")]) == pytest.approx(0.0, abs=1e-9)
    assert abs(tool_point[names.index("Y")]) == pytest.approx(3.0, abs=1e-9)
    assert [axes[names.index(axis)] for axis in "XYZ"] == [3.0, 0.0, 100.0]
    started = of("linuxcnc", "trunnion_bc", kinematics_types=("tool-point", "axes"), tcp_at_start=True)
    text = "G0 X0. Y0. Z100. B0. C90.\nG13.1\nG43 H1\nG1 X3. Y0. Z100.\nG12.1 P0\nG49\nG1 X3. Y0. Z100.\n"
    _, axes, tool_point = ends(text, started)
    assert [axes[names.index(axis)] for axis in "XY"] == [3.0, 0.0]
    assert abs(tool_point[names.index("Y")]) == pytest.approx(3.0, abs=1e-9)
    assert "names no kinematics 7" in refused("G12.1 P7\n", machine)
    assert "needs P" in refused("G12.1\n", machine)


@pytest.mark.parametrize("family", ["linuxcnc", "grbl", "any"])
def test_outputs_and_inputs_move_nothing(family):
    """Y stays at its corrected place behind M64 and M66; where the control is not stated, they might move an axis."""
    text = HEAD + "M64 P2\nM66 P0 L3 Q2\nM67 E0 Q5.\nG1 X20.\nM2\n"
    machine = of(family)
    if family == "any":
        text = text.replace("M67 E0 Q5.\n", "")
    known = read(text, machine).known[-1].tolist()
    assert known == ([2, 1, 1] if family == "any" else [2, 2, 2])


# ---- grbl


def test_zero_set_at_the_present_position_by_grbl():
    """G10 L20 makes the present X11 of the machine X0; G28.1 only stores."""
    text = "G10 L20 P1 X0. Y0.\nG28.1\nG1 X3. Y-1. ; G0 Z9.\nG92 Z0.\nG55\nG1 X1. Y1. Z-2.\n"
    found = ends(text, of("grbl"), offsets=["G54=0,0,0", "G55=100,0,0"])
    assert [found[1], found[3]] == [[14.0, 9.0, 5.0], [101.0, 1.0, 3.0]]


@pytest.mark.parametrize("command", ["$J=G91 X1 F10", "$N0=G20", "$RST=$"])
def test_a_command_of_grbl_shows_no_siemens_program(command):
    machine = of("grbl")
    setup = ncomp.set_up(machine, zero=True)
    with pytest.raises(UserError, match=rf"3: '{re.escape(command)}': .*(jog|stores a block|restores settings)"):
        ncomp.correct(f"G21 G90 G54\nG0 X1 Y1 Z1\n{command}\n", machine, "none", setup=setup)


@pytest.mark.parametrize("command", ["$X", "$H", "$HX"])
def test_positions_after_homing_are_unknown(command):
    text = f"{command}\nG91 G1 X1.\n"
    assert "an increment of X needs a known start" in refused(text, of("grbl"))
    assert ends(f"{command}\nG1 X1. Y2. Z3.\n", of("grbl")) == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("command", ["$$", "$#", "$G", "$I", "$110=5000", "$32=0 (no laser)"])
def test_commands_that_change_no_position(command):
    assert ends(f"{command}\nG91 G1 X1.\n", of("grbl")) == [[12.0, 10.0, 5.0]]


REFUSED = {
    "$100=250": "$100 may change scale",
    "$3=1": "$3 may change scale, direction",
    "$J=G91 X10 F500": "jog command",
    "$RST=#": "restores settings",
    "$C": "check of the program",
    "$N0=G20": "stores a block",
    "$SLP": "to sleep",
    "$QQ": "no command of grbl",
    "G1 X5 $H": "shares its line",
    "G52 X5.": "G52 is no code of grbl",
    "G69": "G69 is no code of grbl",
    "G41 D1": "G41 is no code of grbl",
    "M19": "M19 is no code of grbl",
    "G2 X31.02 R10.009": "no circle of this radius",
}


@pytest.mark.parametrize("line", REFUSED)
def test_what_grbl_does_not_have_is_refused(line):
    assert REFUSED[line] in refused(line + "\n", of("grbl"))


def test_a_command_of_grbl_elsewhere():
    assert 'family = "grbl"' in refused("$H\n", of("any"))


DUMP = "[G54:-10.000,5.000,0.000]\n[G55:1.000,2.000,3.000]\n[G28:0.000,0.000,0.000]\n[TLO:0.000]\n[PRB:0.000,0.000,0.000:0]\nok\n"


def test_the_answer_of_grbl_is_a_table_of_work_offsets(command, tmp_path):
    """X1 in G55 is X2 of the machine, X1 in G54 X-9."""
    (tmp_path / "a.nc").write_text("G21 G90 G54\nG0 X1 Y1 Z1\nG55\nG1 X1 Y1 Z1 F100\n")
    (tmp_path / "offsets.txt").write_text(DUMP)
    line = ("a.nc", "--machine", "gantry", "--tool-table", "offsets.txt", "--calibration", "none", "--no-travel-check")
    done = command(*line, "-o", "out.nc")
    assert done.status == 0, done.err
    shown = " ".join((done.out.decode() + done.err).split())
    assert "G54: X -10, Y 5, Z 0" in shown
    assert "G55: X 1, Y 2, Z 3" in shown
    for bad, reason in {"[TLO:1.500]": "TLO is not 0", "[G54:1.0,x]": "are no numbers", "G10 L2": "is no line"}.items():
        (tmp_path / "offsets.txt").write_text(DUMP.replace("[TLO:0.000]", bad))
        done = command(*line)
        assert done.status == 2
        assert reason in " ".join(done.err.split())


def test_what_grbl_cannot_run(tmp_path):
    """Neither an F for rotary axes of a meaning that is a setting, nor a probing program for LinuxCNC."""
    text = machine_text("w C b X Y Z t", more='[control]\nfamily = "grbl"\nrotary_feed = "scaled"\n')
    (tmp_path / "mill.toml").write_text(text)
    (tmp_path / "a.nc").write_text("G21 G90 G54\nG0 X1. Y1. Z1. C0.\nG1 C9. F100\n")
    line = ("--machine", tmp_path / "mill.toml", "--set-up-zero", "--calibration", "none", "--no-travel-check")
    assert "--rotary-feed scaled: controls differ in the meaning of F" in refusal(tmp_path / "a.nc", *line)
    assert "grbl has no code for TCP" in refusal(tmp_path / "a.nc", *line, "--rotary-feed", "leave", "--tcp", "to-tcp")


@pytest.mark.parametrize(
    ("code", "verdict"), [("G52", "refused"), ("G43.1", "followed"), ("G61", "passes"), ("M19", "refused")]
)
def test_codes_as_grbl_has_them(code, verdict):
    found = ncomp.codes(code, family="grbl").json()["codes"]
    assert [each["verdict"] for each in found if each["dialect"] == "iso"] == [verdict]


# ---- Mach3


MACH3 = {
    "G70\nG1 X1. F9.": [25.4, 10.0, 5.0],
    "G20\nG71\nG1 X1. F9.": [1.0, 10.0, 5.0],
    "G4 P1 X1.": [1.0, 10.0, 5.0],
    "G28.1 X0 Y0\nG0 X3. Y4.": [3.0, 4.0, 5.0],
    "G52 X1.\nG1 X2. F9.": [3.0, 10.0, 5.0],
    "G92 X0\nG1 X2. F9.\nG92.1\nX2.": [2.0, 10.0, 5.0],
    "G73 X1. Z-5. R2. Q1. F9.\nG80\nG0 Y3.": [1.0, 3.0, None],
}
MACH3_REFUSED = {
    "G16": "G16 counts from the present position on Mach3",
    "G51 X2.": "G51 scales each axis by its own word on Mach3",
    "G68 A0 B0 R30.": "G68 has its centre in A and B on Mach3",
    "M47": "M47 runs the program again from its first line on Mach3",
    "G54.1 P1": "G54.1 is no code of Mach3",
    "G43.4 H1": "G43.4 is no code of Mach3",
    "G10 L20 P1 X0": "what mach3 does is not known to ncomp: write it in another form",
    "G1 X1. ,C1. F9.\nY1.": ",C is no word of mach3",
    "G28.1 X0\nG91 G1 X1. F9.": "an increment of X needs a known start",
    "G31 X5. F9.": "G31 is a probing move",
    "$H": "$H is a command of grbl",
}


@pytest.mark.parametrize("text", MACH3)
def test_positions_by_mach3(text):
    found = ends(f"G0 X10. Y10. Z5.\n{text}\n", of("mach3"))[-1]
    assert [a for a, b in zip(found, MACH3[text], strict=True) if b is not None] == [
        b for b in MACH3[text] if b is not None
    ]


@pytest.mark.parametrize("text", MACH3_REFUSED)
def test_what_mach3_reads_in_its_own_way_is_refused(text):
    assert MACH3_REFUSED[text] in refused(f"G0 X10. Y10. Z5.\n{text}\n", of("mach3"))
