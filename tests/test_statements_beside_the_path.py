"""Statements that move nothing pass; suspicious feeds, tools and radii get a note; messages name what controls need."""

import pytest
from support.command import refusal, succeed
from support.machine_texts import machine_text
from support.siemens_programs import ends, read

from kinematics.user_error import UserError

HEAD, TAIL = "G21 G90 G17 G54 G94\nG0 X0. Y0. Z5.\n", "G1 X5. F100\nM30\n"
SIEMENS = "G71 G90 G54\nG0 X0 Y0 Z5\n"


@pytest.fixture
def run(tmp_path):
    """Writes a program and the machine file; returns the arguments of a command."""

    def arguments(text, family="any", ending=".nc"):
        (tmp_path / "mill.toml").write_text(machine_text("w C b X Y Z t", f'[control]\nfamily = "{family}"\n'))
        (tmp_path / f"a{ending}").write_text(text)
        settings = ("--machine", tmp_path / "mill.toml", "--calibration", "none", "--set-up-zero")
        return (tmp_path / f"a{ending}", *settings, "-o", tmp_path / "out")

    return arguments


def shown(arguments):
    return " ".join(succeed(*arguments).shown.split())


PASSING = {
    "alarm": "IF[1 EQ 2] THEN #3000=1(TOOL)\n",
    "stop with a message": "#3006=1(TURN THE PART)\n",
    "clock": "#3001=0\n#3002=0\n",
    "single block": "#3003=1\n#3004=2\n",
    "output": "POPEN\nDPRNT[X#5041[53]***Y#101[44]]\nBPRNT[C*X#100[0]]\nPCLOS\n",
}


@pytest.mark.parametrize("family", ["any", "fanuc"])
@pytest.mark.parametrize("case", PASSING)
def test_iso_statements_that_move_nothing_pass(case, family, run):
    succeed(*run(HEAD + PASSING[case] + TAIL, family))


def test_what_a_clock_reads_is_not_known(run):
    assert "#3001 is not known: it is a clock of the control" in refusal(
        *run(HEAD + "#3001=0\nX#3001\n" + TAIL, "fanuc")
    )


@pytest.mark.parametrize("statement", ["$AC_TIMER[1]=0", "$AC_MARKER[2]=R1+1", "$AC_PARAM[3]=5"])
def test_siemens_statements_that_move_nothing_pass(statement, run):
    succeed(*run(f"{SIEMENS}{statement}\nG1 X5 F100\nM30\n", ending=".mpf"))


MESSAGES = {
    "a length from the present position": ("G10 L10 P1 Z5.\n", "linuxcnc", "of LinuxCNC sets a length from the present position"),
    "wear in another form": ("G10 L11 P1 Z5.\n", "fanuc", "write G10 L10 or L11 with P and R"),
    "a length of unknown kind": ("G10 L10 P1 Z5.\n", "any", 'write family = "fanuc" or "linuxcnc"'),
    "a given length": ("G43.1 Z5.\n", "fanuc", "G43.1 of FANUC moves along the tool axis"),
    "a dwell with a move": ("G4 P1. X5.\n", "fanuc", "write the move in a block of its own"),
    "a cancelled preset with a move": ("G92.1 X5.\n", "linuxcnc", "write the move in a block of its own"),
    "inches": ("G70\n", "any", "write G20 or G21"),
    "inches on FANUC": ("G71\n", "fanuc", "G71 is no unit on this control"),
}  # fmt: skip


@pytest.mark.parametrize("case", MESSAGES)
def test_messages_are_those_of_the_stated_control(case, run):
    block, family, reason = MESSAGES[case]
    said = " ".join(refusal(*run(HEAD + block + TAIL, family)).split())
    assert reason in said
    assert family == "any" or "write family" not in said


TURNING = """O0100
G21 G99 G40
G50 S2000
T0101
G96 S200 M3
G0 X100. Z5.
{cycle}
N10 G0 X20.
G1 Z-30. F0.2
N20 X100.
G70 P10 Q20
M30
"""
TURNING_CYCLES = (
    "G71 U2. R1.\nG71 P10 Q20 U1. W0.1 F0.2",
    "G72 W2. R1.\nG72 P10 Q20 U1. W0.1 F0.2",
    "G73 U5. W5. R3\nG73 P10 Q20 U1. W0.1 F0.2",
    "G75 R1.\nG75 X40. Z-20. P3000 Q3000 F0.1",
    "G76 P010060 Q100 R0.2",
)


@pytest.mark.parametrize("family", ["any", "fanuc"])
@pytest.mark.parametrize("cycle", TURNING_CYCLES)
def test_a_turning_program_is_refused_as_one(cycle, family, run):
    said = " ".join(refusal(*run(TURNING.format(cycle=cycle), family), "--dialect", "iso").split())
    assert "this is a turning program, which ncomp does not correct. Its X is a diameter" in said
    assert "--pass-through" not in said


@pytest.mark.parametrize(
    "cycle", ["G73 X5. Y5. Z-5. R2. P100 Q1. F100\nG80\n", "G76 X5. Z-5. R2. P100 Q1. F100\nG80\n"]
)
def test_cycles_of_mills_with_p_and_q_are_none_of_a_lathe(cycle, run):
    succeed(*run(HEAD + cycle + TAIL, "fanuc"))


def test_units_of_mach3(run):
    assert "G71 is taken for mm" in shown(run("G90 G71 G17 G54\nG0 X10. Y10. Z5.\nG1 X30. F200\nM30\n"))
    assert "G71 is taken for mm" in shown(run(HEAD + "G71\n" + TAIL))


def test_a_program_elsewhere_is_named(run):
    said = refusal(*run(SIEMENS + 'EXTCALL "SUB.SPF"\n', ending=".mpf"))
    assert 'EXTCALL "SUB.SPF"' in said
    assert "give its folder by --subprograms" in said


# ---- frames of Siemens: coarse and fine


FRAMES = {
    "the coarse part alone": ("$P_UIFR[1]=CTRANS(X,100):CFINE(X,0.01)\n$P_UIFR[1,X,TR]=200", 200.01),
    "the fine part alone": ("$P_UIFR[1]=CTRANS(X,100):CFINE(X,0.01)\n$P_UIFR[1,X,FI]=0.02", 100.02),
    "another axis": ("$P_UIFR[1]=CTRANS(X,100):CFINE(X,0.01,Y,0.5)\n$P_UIFR[1,Y,TR]=7", 100.01),
    "both again": ("$P_UIFR[1]=CTRANS(X,100):CFINE(X,0.01)\n$P_UIFR[1]=CTRANS(X,50)", 50.0),
    "fine first": ("$P_UIFR[1]=CFINE(X,0.01):CTRANS(X,100)\n$P_UIFR[1,X,TR]=0", 0.01),
    "a variable": ("DEF FRAME FRM\nFRM=CTRANS(X,3):CFINE(X,0.5)\n$P_UIFR[1]=FRM\n$P_UIFR[1,X,TR]=4", 4.5),
}  # fmt: skip


@pytest.mark.parametrize("case", FRAMES)
def test_coarse_and_fine_shifts_stay_apart(case):
    text, x = FRAMES[case]
    motions = read(text + "\nG54\nG0 G90 X1 Y0 Z0\nM30\n")
    assert motions.machine_target[-1, motions.machine.index("X")] == pytest.approx(1.0 + x)


def test_a_lone_part_of_a_turned_frame_is_refused():
    with pytest.raises(UserError, match="rotated, scaled or mirrored"):
        ends("$P_UIFR[1]=CTRANS(X,100)\n$P_UIFR[1,Z,RT]=5\nG54\nG0 X1\n")


# ---- notes


def test_suspicious_values_get_a_note(run):
    assert "a feed move has no F before it" in shown(run(HEAD + "G1 X5.\nM30\n"))
    assert "no F before it" not in shown(run(HEAD + TAIL))
    assert "F0 in a canned cycle" in shown(run(HEAD + "G98 G81 X1. Z-1. R2. F0\nG80\nM30\n"))
    assert "C turns by half a turn or more in a feed move" in shown(run(HEAD + "G1 C350. F100\nC0.\nM30\n"))
    assert "turns by half a turn" not in shown(run(HEAD + "G1 C150. F100\nG0 C350.\nM30\n"))
    short = run(HEAD.replace("G0", "T1 M6\nG43 H1\nG0", 1) + TAIL)
    assert "T1 is 0.11 mm long: lengths are in mm" in shown((*short, "--tool-length", "T1=0.11"))
    assert "mm long" not in shown((*short, "--tool-length", "T1=110"))


@pytest.mark.parametrize("radius", ["9.9999", "9.9990", "9.9985", "9.9", "10."])
def test_a_short_radius_is_read_like_linuxcnc(radius, run, linuxcnc):
    text = f"G21 G90 G17 G54 G94\nG0 X0. Y0. Z5.\nG2 X20. Y0. R{radius} F100\nM2\n"
    accepted = linuxcnc.run(text).exit_status == 0
    if accepted:
        assert ("radius of an arc is too short" in shown(run(text, "linuxcnc"))) == (radius != "10.")
    else:
        assert "no circle of this radius" in refusal(*run(text, "linuxcnc"))


def test_a_short_radius_is_noted_elsewhere(run):
    text = "G21 G90 G17 G54 G94\nG0 X0. Y0. Z5.\nG2 X20. Y0. R9.99 F100\nM30\n"
    assert "radius of an arc is too short" in shown(run(text))
