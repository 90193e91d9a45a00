"""ISO blocks that controls read differently: refused, unless `family` in the machine file decides; by LinuxCNC."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from support.programs import correct, load, random_model, read, shifted
from support.tiers import quick

import machines
from kinematics.user_error import UserError
from postproc.compensation.correction import pose_errors

HEAD = "G21 G90 G17 G54 G94\nG0 X1000. Y1000. Z-500.\nG1 X1100. F500\n"
MACHINES = Path(machines.__file__).parent


def with_family(name, family):
    machine = load(name)
    return dataclasses.replace(machine, control=dataclasses.replace(machine.control, family=family))


@pytest.fixture
def check(command, tmp_path):
    """Refusals `(line, reason)` of a program, by the command, for a control of a family."""

    def refusals(text, family="any", machine="gantry"):
        (tmp_path / "a.nc").write_text(text)
        said = (MACHINES / f"{machine}.toml").read_text().replace("[control]", f'[control]\nfamily = "{family}"')
        if "[control]" not in said:
            said += f'\n[control]\nfamily = "{family}"\n'
        (tmp_path / "mill.toml").write_text(said)
        done = command("check", "a.nc", "--machine", "mill.toml", "--set-up-zero", "--no-travel-check")
        assert done.status in (0, 2), done.err
        return done.status, done.out.decode() + done.err

    return refusals


def test_words_of_a_dwell_move_on_some_controls(check):
    """The block as it was found: LinuxCNC and Mach3 move to X1300, a dwell by P elsewhere."""
    program = HEAD + "G4 P1 X1300.\nG1 Y1400.\nY1000.\nM30\n"
    reasons = {"any": "axis words with G4 P are a move on LinuxCNC", "fanuc": "no axis words beside the P of G4"}
    for family, reason in reasons.items():
        status, text = check(program, family)
        assert status == 2
        assert reason in text
    assert check(program, "linuxcnc")[0] == 0


# text after HEAD: the families that refuse it
BLOCKS = {
    "G0 G20 G17 G90 G40 G49 G80": "",
    "G0 G80\nX1200.": "",
    "G80 G0\nX1200.": "",
    "G80 G1 X1200.": "",
    "G80 X1200.": "",
    "G81 X1200. Y1000. Z-510. R-505.\nG80 G0 X1100.": "",
    "G81 X1200. Y1000. Z-510. R-505.\nG80\nX1100.": "linuxcnc",
    "G2\nG81 X1200. Y1000. Z-510. R-505.\nG80\nX1100.": "any fanuc linuxcnc",
    "G53": "",
    "G81 Z-510. R-505. K0\nX1200.": "linuxcnc",
    "G81 X1150. Z-510. R-505. L0\nX1200.": "any fanuc linuxcnc",
    "G91 G81 Z-5. R-5. K0\nX1200.": "any fanuc linuxcnc",
    "G98 G81 X1150. Y1000. Z-510. R-505.\nG91 X10. L3\nG90 G80": "any linuxcnc",
    "G98 G81 X1150. Y1000. Z-510. R-505.\nG91 X10. Z-5.\nG90 G80": "any fanuc linuxcnc",
    "M61 Q3": "any fanuc",
    "G00 G17 G40 G49 G50 G69 G80 G90\nX1200.": "",
    "G54 G92.1\nG1 X1200.": "",
    "G52 X50.\nG55 G92.1\nG1 X1200. Y1000. Z-500.": "",
    "G68 X0. Y0. R1.\nG54 G69\nG1 X1200. Y1000.": "",
    "G51.1 X1000.\nG0 G50.1\nX1200.": "",
    "G50 G0 X1200.": "any fanuc linuxcnc",
    "G81 X1200. Y1000. Z-510. R-505.\nG20 X47.": "any fanuc linuxcnc",
    "G81 X1200. Y1000. Z-510. R-505.\nG20 G81 X47.": "any fanuc linuxcnc",
    "G81 X1200. Y1000. Z-510. R-505.\nG20 G81 X47. Z-20. R-19.8\nG80": "",
    "G52 X5.\nG0 X1000. Y1000. Z-500.\nG81 Z-510. R-505.\nG92.1\nX1200.": "any fanuc linuxcnc",
    "G52 X5.\nG0 X1000. Y1000. Z-500.\nG81 Z-510. R-505.\nG80 G92.1\nG1 X1200. Y1000. Z-500.": "",
    "G82 X1150. Y1000. Z-510. R-505. P0\nG82 X1200.\nG80": "",
    "G82 X1150. Y1000. Z-510. R-505. P0\nG81 X1200.\nG80": "linuxcnc",
    "G81 X1150. Y1000. Z-510. R-505.\nG80\nG81 X1200.\nG80": "any fanuc linuxcnc",
    "G99 G81 X1150. Y1000. Z-510. R-495.\nX1200.\nG80": "",
    "G98 G81 X1150. Y1000. Z-510. R-495.\nX1200.\nG80": "any",
    "G98 G81 X1150. Y1000. Z-510. R-495.\nX1200. R-505.\nG80": "any",
    "G98 G19 G81 X1150. Y1000. Z-500. R1120.\nG80": "linuxcnc",
    "G91 G99 G81 X10. Z-5. R-5. L3\nX10. R-2. Z-3.\nG90 G80": "",
    "G91 G98 G81 X10. Z-5. R5. L3\nX10. R-2. Z-3.\nG90 G80": "any",
    "G98 G81 X1150. Z-510. R-505. F0": "linuxcnc",
    "G28.1\nG1 X1200.": "fanuc",
    "G28.1 X1200. Y1005.\nG1 Z-501.": "any fanuc",
    "G28.2 P-1": "any fanuc linuxcnc",
    "G40.1\nG1 X1200.": "linuxcnc",
    "G41.1 D1.\nG1 X1200. Y1010.\nG40": "fanuc",
    "G71\nG1 X1200.": "fanuc linuxcnc",
    "G53.5 G1 X1200.": "any fanuc",
    "G28.5\nG1 X1200. Y1000.": "any fanuc",
    "G12.1 P1": "any fanuc linuxcnc",
    "G10 L20 P0 X0.\nG1 X100.": "",
    "G10 L20 P1 X0.\nG1 X100.": "any",
    "$H": "any fanuc linuxcnc",
    "G1 X1200. ; G0 X5.\nG1 Y1010.": "any fanuc",
    "o1 sub\n#31 = 4\nG1 X[1000 + #1 + #31]\no1 end sub\n#31 = 7\no1 call [20]\nG1 Y[1000 + #31]": "any",
    "o1 sub\nG1 X[1000 + #1]\no1 endsub\n#5 = 1\no[#5] call [20]\no[#5 + 0] call [30]\no#5 call [40]": "",
    "#1 = 2\no1 if [#1 EQ 1]\nG1 X1110.\no1 else if [#1 + 1 EQ 3 AND 1 NE 2]\nG1 X1120.\no1 else\nG1 X1130.\no1 endif": "",
    "IF [1 EQ 1 AND 2 NE 3] GOTO 10\nN10 G1 X1200.": "any fanuc linuxcnc",
    "#5599 = 1": "",
    "#4000 = 1200\nG1 X#4000": "any fanuc",
    "#5221 = 7": "any fanuc linuxcnc",
    "#1 = 1000\nWHILE [#1 LT 1001] DO1\n#1 = #1 + 0.1\nG1 X#1\nEND1": "any",
    "#1 = 1000\no1 while [#1 LT 1001]\n#1 = [#1 + 0.1]\nG1 X#1\no1 endwhile": "any",
    "G1 X[1100 + ROUND[-2.5]]": "any",
    "G1 X[1100 + FIX[-2.5] + FUP[-2.5]]": "any",
    "G1 X[1100 + ATAN[1]/[-1]]": "any fanuc",
    "G1 X[1100 + [-7 MOD 3]]": "any fanuc",
    "G1 X[1100 + [2 AND 4]]": "any fanuc",
    "IF [#0 EQ #0] GOTO 10\nG1 X1300.\nN10 G1 X1200.": "any linuxcnc",
    "G81 G80 X1200. Z-510. R-505.": "any fanuc linuxcnc",
    "G0 G81 X1200. Z-510. R-505.": "any fanuc linuxcnc",
    "G68 X0. Y0. R10. G69": "any fanuc linuxcnc",
    "G4 X2.": "",
    "G4 U2.": "",
    "G4 P1": "",
    "G4 P1 M8 F100": "",
    "G4 X2. Y3.": "any fanuc linuxcnc",
    "G4 Y3.": "any fanuc linuxcnc",
    "G4 P1 R2.": "any fanuc linuxcnc",
    "G4 P1 G0 X1200.": "any fanuc",
    "G4 P2 G64 P0.1": "any fanuc linuxcnc",
    "G64 P1 G3 X1200. Y1000. I50.": "any fanuc linuxcnc",
    "G92.1 X1200.": "any linuxcnc",
    "G92.1": "",
    "G92.2 X1200.": "any fanuc linuxcnc",
    "G43.1 Z5.": "any fanuc",
    "G28 X1200. R5.": "any fanuc linuxcnc",
    "G28 X1200. I5.": "any fanuc linuxcnc",
    "G30 P2 X1200.": "",
    "G53 G0 X1200. L3": "any fanuc linuxcnc",
    "G81 X1200. Y1000. Z-510. R-505.\nG28 X1100.\nX1200.": "any fanuc linuxcnc",
    "M19 R90.": "",
    "M19 R90. X1200.": "",
    "G2 M19 R90. X1200. Y1000.": "any fanuc linuxcnc",
    "G81 X1200. Y1000. Z-510. R-505.\nM19 R-495.": "any fanuc linuxcnc",
    "M66 P0 L3 Q2": "fanuc",
    "M66 P0 L3 Q2 X1200.": "fanuc",
    "M64 P2 G3 X1200. Y1000. I50.": "any fanuc linuxcnc",
    "M67 E0 Q5. X1200.": "any fanuc",
    "M3 S100 $0": "",
    "G2 X1200. Y1000. I50.\nG10 L2 P2 X5.\nG1 X1250.": "",
    "G10 L2 P0 X5.\nG1 X1200.": "any fanuc",
    "G55\nG10 L2 P0 X5.\nG1 X1200. Y1000.": "any fanuc",
    "o1 sub\no1 endsub [1050 + #1]\no1 call [7]\nG1 X#<_value>\nG1 Y[1000 + #<_value_returned>]": "",
    "o1 sub\no2 if [1]\no1 return [1050]\no2 endif\no1 endsub\no1 call\nG1 X#<_value>": "",
    "o1 sub\no1 endsub [1050]\no2 sub\no2 endsub\no1 call\no2 call\nG1 X[#<_value> + #<_value_returned>]": "",
    "G1 X[1050 + #<_value> + #<_value_returned>]": "",
    "#<a> = 1\nG1 X[1050 + EXISTS[#<a>] + EXISTS[#<b>] + EXISTS[#5]]": "",
    "G1 X[1050 + EXISTS[#<_b>]]": "any fanuc linuxcnc",
}  # fmt: skip


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("family", ["any", "fanuc", "linuxcnc"])
def test_family_decides_what_controls_read_differently(block, family, check):
    status, text = check(HEAD + block + "\nM30\n", family)
    assert status == (2 if family in BLOCKS[block].split() else 0), text


TAKEN = [block for block, refusing in BLOCKS.items() if "linuxcnc" not in refusing]


@pytest.mark.parametrize("block", quick(TAKEN, TAKEN[::3]))
def test_linuxcnc_ends_where_ncomp_says(block, linuxcnc):
    """Blocks that LinuxCNC refuses are no danger."""
    program = HEAD + block + "\nG1 Z-490.\nM30\n"
    result = linuxcnc.run(program)
    if result.exit_status == 0:
        motions = read(program, with_family("gantry", "linuxcnc"))
        assert motions.machine_target[-1, :2] == pytest.approx(result.moves[-1].machine[:2], abs=1e-9)


def test_a_leader_before_the_first_tape_mark(check, command):
    """Controls pass over it; the mark of ncomp comes behind it."""
    program = "* PART 4711, REV B\nPOST: 5.2\n%\nO1234 (PART)\nG21 G90 G54\nG0 X100. Y50. Z50.\nM30\n%\n"
    status, text = check(program)
    assert status == 0, text
    assert "taken for the leader of a tape" in text
    done = command("a.nc", "--machine", "dmu50", "--no-travel-check")
    assert done.status == 0, done.err
    assert done.out.decode().startswith("* PART 4711, REV B\nPOST: 5.2\n%\nO1234 (PART)\n(")
    done = command("a.nc", "--machine", "gantry", "--calibration", "none", "--no-travel-check")
    assert done.out.decode() == program


@pytest.mark.parametrize(
    "program",
    [
        HEAD + "G1 Y1&00.\nM30\n%\n",  # a slip, and the mark that ends the tape
        "* PART\nG0 X1.\n%\nO1\n" + HEAD + "M30\n%\n",  # words that another control would run
        "* PART\n#1=5\n%\nO1\n" + HEAD + "M30\n%\n",
    ],
)
def test_what_is_no_leader(check, program):
    status, text = check(program)
    assert status == 2
    assert "is not understood" in text


LONG = "G1 X120. Y110. F500 ("
"""Corrected by the demonstration calibration, it gets longer."""


def padded(size):
    return LONG + "a" * (size - len(LONG) - 2) + ")\n"


def test_lines_that_linuxcnc_can_read(check, linuxcnc):
    """Its buffer has 255 characters, of which it reads 253 with the end of the line."""
    assert linuxcnc.run(HEAD + padded(253) + "M30\n").exit_status == 0
    assert linuxcnc.run(HEAD + padded(254) + "M30\n").exit_status != 0
    assert check(HEAD + padded(253) + "M30\n", "linuxcnc")[0] == 0
    for line in (padded(254), "(" + "a" * 300 + ")\n"):
        status, text = check(HEAD + line + "M30\n", "linuxcnc")
        assert status == 2
        assert "LinuxCNC reads 253" in text
        assert check(HEAD + line + "M30\n", "any")[0] == 0


@pytest.mark.parametrize(("family", "size", "status"), [("any", 253, 2), ("fanuc", 253, 0), ("any", 254, 0)])
def test_a_corrected_line_that_linuxcnc_could_not_read(check, command, tmp_path, family, size, status):
    """Refused, unless its own line is too long for LinuxCNC already, or the machine file names another control."""
    check("G21 G90 G54\nG0 X100. Y50. Z50.\n" + padded(size) + "M30\n", family, "dmu50")
    calibration = MACHINES / "calibrations" / "dmu50.json"
    done = command("a.nc", "--machine", "mill.toml", "--calibration", calibration, "--no-travel-check", "-o", "out.nc")
    assert done.status == status, done.err
    assert ("LinuxCNC reads 253: make it shorter" in " ".join(done.err.split())) == (status == 2)
    assert (tmp_path / "out.nc").exists() == (status == 0)


def macro(call):
    return (
        HEAD + f"G65 P100 {call}\nM30\nO100\nIF [#1 EQ #0] GOTO 10\nIF [0 EQ #2] GOTO 20\nG1 X[1200+#1]\nM99\n"
        "N10 G1 X1300.\nM99\nN20 G1 X1350.\nM99\n"
    )


@pytest.mark.parametrize(("call", "x"), [("A7. B2.", 1207), ("B2.", 1300), ("A7. B0.", 1350), ("A7.", 1207)])
def test_an_argument_that_a_call_leaves_out_is_empty_on_fanuc(call, x):
    """It equals #0 and nothing else, not even 0."""
    motions = read(macro(call), with_family("gantry", "fanuc"))
    assert motions.machine_target[-1, 0] == x


VACANT = {
    # by the tables of FANUC's and Mitsubishi's manuals: 0 in arithmetic, an empty variable when it is only assigned
    "#100=#0\n#150=#100+1": 1, "#150=#0+#0": 0, "#150=#0*10": 0, "#150=10/[1+#0]": 10, "#150=COS[#0]": 1,
    "#100=#0\n#101=#100\n#150=0\nIF[#101EQ#0]THEN#150=1": 1, "#101=#0*1\n#150=0\nIF[#101EQ#0]THEN#150=1": 0,
    "#150=0\nIF[#0EQ0]THEN#150=1": 0, "#150=0\nIF[#0NE0]THEN#150=1": 1, "#150=0\nIF[#0NE#0]THEN#150=1": 0,
    "#150=0\nIF[#0GE#0]THEN#150=1": 1, "#150=0\nIF[#0GT0]THEN#150=1": 0, "#150=0\nIF[#0LE0]THEN#150=1": 1,
    "#150=0\nIF[#0LT0]THEN#150=1": 0, "#150=0\nIF[#0LT3]THEN#150=1": 1,
}  # fmt: skip


@pytest.mark.parametrize("lines", VACANT)
def test_an_empty_variable_counts_as_0_in_arithmetic_on_fanuc(lines):
    motions = read(f"{HEAD}{lines}\nG1 X[1200+#150]\nM30\n", with_family("gantry", "fanuc"))
    assert motions.machine_target[-1, 0] == 1200 + VACANT[lines]


@pytest.mark.parametrize("line", ["X#100", "X-#100", "X+#100", "M98 P#100", "IF[-#100EQ#0]GOTO10"])
def test_a_word_of_an_empty_variable_is_no_0(line):
    """FANUC leaves the word out: it goes nowhere."""
    with pytest.raises(UserError, match=r":5: .*( it|the variable) is empty.*: give it a value before this block"):
        read(f"{HEAD}#100=#0\n{line}\nM30\n", with_family("gantry", "fanuc"))


def test_increments_between_holes_keep_their_depth_on_fanuc():
    """The bottom stays at its programmed position under G90 and G91; inserted words count as the block does."""
    text = "G21 G90 G54 G17 G98\nG0 X10. Y5. Z100.\nG81 Z-20. R2. F100\nG91 X10. Y5.\nX10.\nG90 X50.\nG80\nG0 Z90.\n"
    machine = with_family("gantry", "fanuc")
    nominal = read(text, machine)
    model = random_model(machine, 4)
    result = correct(text, machine, model, travel_check=False, tolerance_um=1e3)
    commanded = read(result.text, machine)
    assert len(re.findall(r"R-?[0-9]", result.text)) == 4
    np.testing.assert_allclose(nominal.machine_target[1:5, 2], -20.0)
    errors = pose_errors(machine, model, commanded.machine_target, nominal.machine_target, nominal.tool).point_um
    assert errors[1:5].max() < 0.5
    assert (np.diff(commanded.machine_target[1:5, 2]) != 0.0).any()


def test_a_cycle_that_is_only_set_is_corrected_at_its_first_hole():
    """K0 drills nothing; the first hole gets the words that hold for it."""
    machine = with_family("gantry", "fanuc")
    text = "G21 G90 G54 G17 G98\nG0 X10. Y5. Z100.\nG81 Z-20. R2. F100 K0\nX20.\nX30.\nG80\nG0 Z90.\n"
    written = correct(text, machine, shifted(machine, X=3.0, Z=5.5), travel_check=False).text.splitlines()
    assert written[3:6] == ["G81 Z-20. R2. F100 K0", "X19.9970 R1.9945 Z-20.0055", "X29.9970"]


@pytest.mark.parametrize(("family", "refused"), [("any", True), ("fanuc", True), ("linuxcnc", False)])
def test_the_level_of_a_cycle_in_another_work_offset(family, refused):
    """G98 returns to its number on LinuxCNC and to its position elsewhere: no increment may start there."""
    text = HEAD + "G98 G81 X1200. Z-510. R-505.\nG55 X1100.\nG80 G0 X1000.\nG91 Z5.\n"
    setup = {"offsets": ["G54=0,0,0", "G55=0,0,-20"]}
    if refused:
        with pytest.raises(UserError, match="an increment of Z needs a known start"):
            read(text, with_family("gantry", family), **setup)
    else:
        motions = read(text, with_family("gantry", family), **setup)
        assert motions.machine_target[-1, 2] == -500.0 - 20.0 + 5.0
