"""What a program leaves open and the user states: where the tool stands at its start, and what probing finds."""

import pytest
from support.command import refusal, succeed
from support.machine_texts import machine_text
from support.programs import load, shifted

import ncomp
from kinematics.error_model.model import write_model
from kinematics.user_error import UserError

HEADS = {"iso": "G21 G17 G54\n", "siemens": "G71 G17 G54\nT1 D1\n", "heidenhain": "BEGIN PGM A MM\n"}
ENDS = {"iso": "M2\n", "siemens": "M30\n", "heidenhain": "END PGM A MM\n"}


def places(text, dialect, **stated):
    """X, Y, Z of the gantry, mm, after each move."""
    setup = ncomp.set_up("gantry", work_offset=["G54=100,200,0", "0=100,200,0"], tool_length=["T1=0"], **stated)
    done = ncomp.correct(
        HEADS[dialect] + text + ENDS[dialect], "gantry", "none", dialect=dialect, setup=setup, travel_check=False
    )
    return done.moves.machine_target.tolist()


# a program that begins with increments, from X1 Y2 Z5: by hand
INCREMENTS = {
    "iso": "G91 G1 X10. Z-1. F300\nG2 X10. Y0. I5. J0.\nG90 G1 X0.\n",
    "siemens": "G91 G1 X10 Z-1 F300\nG2 X10 Y0 I5 J0\nG90 G1 X0\n",
    "heidenhain": "L IX+10 IZ-1 R0 F300\nL IX+10\nL X+0\n",
}


@pytest.mark.parametrize("dialect", INCREMENTS)
def test_increments_count_from_the_declared_start(dialect):
    found = places(INCREMENTS[dialect], dialect, start="X1,Y2,Z5")
    assert found == [[111.0, 202.0, 4.0], [121.0, 202.0, 4.0], [100.0, 202.0, 4.0]]
    with pytest.raises(UserError, match="an increment of X"):
        places(INCREMENTS[dialect], dialect)


def test_the_start_itself_is_not_corrected():
    """The first increment takes the whole correction, 3 um along X; the next ones keep it, and Y gets its own."""
    machine = load("gantry")
    text = "G21 G91 G17 G54\nG1 X10. F300\nX10.\nY5.\nG90 X0.\nM2\n"
    setup = ncomp.set_up(machine, zero=True, start="X0,Y0,Z0", datum=["G54=true"])
    done = ncomp.correct(text, machine, shifted(machine, X=3.0, Y=-2.0), setup=setup, travel_check=False)
    lines = done.text.splitlines() if isinstance(done.text, str) else done.text.decode().splitlines()
    assert lines[2:6] == ["G1 X9.9970 F300", "X10.", "Y5.0020", "G90 X-0.0030"]


def test_a_position_set_at_the_declared_start():
    """G92 and G10 L20 name the place where the tool stands: X1 becomes X0."""
    assert places("G90\nG92 X0. Y0.\nG1 X5. F100\n", "iso", start="X1,Y2,Z5")[-1] == [106.0, 202.0, 5.0]
    assert places("G90\nG10 L20 P0 X0. Y0.\nG1 X5. F100\n", "iso", start="X1,Y2,Z5")[-1] == [106.0, 202.0, 5.0]
    assert places("G90\nG92 X0.\nG91 G1 X5. Y1. F100\n", "iso", start="X1,Y2,Z5")[-1] == [106.0, 203.0, 5.0]


def test_a_zero_that_is_set_where_it_is():
    """G10 L20 P1 of a router at X0 Y0 changes nothing; elsewhere LinuxCNC and FANUC differ, and a family decides."""
    text = "G90\nG10 L20 P1 X0. Y0.\nG1 X5. Y1. F100\n"
    assert places(text, "iso", start="X0,Y0,Z5")[-1] == [105.0, 201.0, 5.0]
    for start in ("X1,Y0,Z5", "X0,Z5"):
        with pytest.raises(UserError, match="G10 L20 sets different data on FANUC and on LinuxCNC"):
            places(text, "iso", start=start)


def test_the_start_is_in_the_coordinates_of_the_first_move():
    """In TRANS X50 the tool stands at X1 of the shifted coordinates."""
    assert places("TRANS X50\nG91 G1 X1 F100\n", "siemens", start="X1,Y2,Z5")[-1] == [152.0, 202.0, 5.0]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.nc", "G21 G90 G17 G54\nG2 X20. Y10. I5. J0. F300\nM2\n"),
        ("a.mpf", "G71 G90 G17 G54\nG2 X20 Y10 CR=5 F300\nM30\n"),
    ],
)
def test_an_arc_from_the_start_is_refused_with_its_cure(tmp_path, name, text):
    """The tool stands at the start without a correction, so that no circle joins it with the corrected end."""
    write_model(shifted(load("gantry"), X=3.0), tmp_path / "cal.json")
    line = ("--machine", "gantry", "--set-up-zero", "--datum", "G54=true", "--calibration", tmp_path / "cal.json")
    line = (*line, "--start", "X10,Y10,Z50", "--no-travel-check")
    (tmp_path / name).write_text(text)
    assert "and --start is not enough: write G0, G1 or L to it" in refusal(tmp_path / name, *line)
    (tmp_path / name).write_text(text.replace("\nG2", "\nG0 X10 Y10\nG2"))
    succeed(tmp_path / name, *line, "-o", tmp_path / f"out_{name}")


def test_a_correction_belongs_to_its_start(tmp_path):
    """Verified from another start, the program is that of another set-up."""
    machine = load("gantry")
    write_model(shifted(machine, X=3.0), tmp_path / "cal.json")
    (tmp_path / "a.nc").write_text("G21 G91 G17 G54\nG1 X10. Y0. Z0. F300\nX10.\nM2\n")
    line = ("--machine", "gantry", "--set-up-zero", "--datum", "G54=true", "--calibration", tmp_path / "cal.json")
    done = succeed(tmp_path / "a.nc", *line, "--start", "X0,Y0,Z0", "--no-travel-check", "-o", tmp_path / "b.nc")
    assert "the tool is taken to stand at X0 Y0 Z0 when the program starts" in " ".join(done.shown.split())
    verified = ("verify", tmp_path / "a.nc", tmp_path / "b.nc", *line, "--start")
    succeed(*verified, "X0,Y0,Z0")
    assert "was corrected with another set-up" in refusal(*verified, "X1,Y0,Z0")


def test_a_tool_change_takes_its_axes_from_the_start():
    with pytest.raises(UserError, match="an increment of Z needs a known start"):
        places("G91 T1 M6\nG1 Z-1. F300\n", "iso", start="X1,Y2,Z5")


def test_start_in_files(tmp_path):
    (tmp_path / "a.nc").write_text(HEADS["iso"] + INCREMENTS["iso"] + ENDS["iso"])
    (tmp_path / "mill.toml").write_text(machine_text(more='[control]\nstart = "X1,Y2,Z5"\n'))
    line = ("--set-up-zero", "--no-travel-check", "--calibration", "none")
    program, mill = tmp_path / "a.nc", tmp_path / "mill.toml"
    succeed(program, "--machine", mill, *line, "-o", tmp_path / "b.nc")
    succeed(program, "--machine", "gantry", *line, "--start", "X1,Y=2,z5", "-o", tmp_path / "b.nc")
    job = 'machine = "gantry"\ncalibration = "none"\nset_up_zero = true\nstart = "X1,Y2,Z5"\n[programs]\n"a.nc" = "b.nc"\n'
    (tmp_path / "job.toml").write_text(job + "[correction]\ntravel_check = false\n")
    (tmp_path / "b.nc").unlink()
    succeed(tmp_path / "job.toml")
    assert (tmp_path / "b.nc").read_bytes() == program.read_bytes()
    for bad, reason in {
        "X1,X2": "X is given twice",
        "Q5": "has no axis 'Q'",
        "X1.5.2": "X1.5.2",
        "5": "expected X0,Y0",
    }.items():
        assert reason in refusal(program, "--machine", "gantry", *line, "--start", bad)


# ---- probing

PROBING = {
    "iso": ("G90 G0 X10. Y10. Z5.\nG31 Z-5. F100\nG0 Z5.\nX10. Y10.\nG1 X20. F300\n", "G1 X[20.+#5063] F300\n"),
    "siemens": ("G90 G0 X10 Y10 Z5\nR1=3\nCYCLE978(0,1,1,1,10,1,0,0,1)\nG0 Z5\nX10 Y10\nG1 X20 F300\n", "G1 X=20+R1\n"),
    "heidenhain": (
        "L X+10 Y+10 Z+5 R0 FMAX\nQ5 = 3\nTCH PROBE 412 DATUM INSIDE CIRCLE ~\n Q321=+0 ;CENTER ~\n Q322=+0\n"
        "L Z+5 FMAX\nL X+10 Y+10\nL X+20 F300\n",
        "L X+Q5\n",
    ),
}


@pytest.mark.parametrize("dialect", PROBING)
def test_a_contour_beside_probing(dialect):
    """Positions behind the probing are those of the program; what depends on its result is refused all the same."""
    text, dependent = PROBING[dialect]
    assert places(text, dialect, probing="beside")[-1] == [120.0, 210.0, 5.0]
    with pytest.raises(UserError, match=r"known|not set by the program"):
        places(text + dependent, dialect, probing="beside")
    with pytest.raises(UserError, match=r"probing.beside|--probing beside|probing="):
        places(text, dialect)


def test_an_increment_behind_probing_is_refused():
    text = "G90 G0 X10. Y10. Z5.\nG38.2 Z-5. F100\nG91 G0 Z5.\n"
    with pytest.raises(UserError, match="an increment of Z needs a known start"):
        places(text, "iso", probing="beside")


def test_a_probing_move_of_linuxcnc_is_modal():
    with pytest.raises(UserError, match="the coordinates have no G0, G1, G2 or G3 before them"):
        places("G90 G0 X10. Y10. Z5.\nG38.2 Z-5. F100\nX20.\n", "iso", probing="beside")


def test_probing_in_files(tmp_path):
    text = PROBING["siemens"][0]
    (tmp_path / "a.mpf").write_text(HEADS["siemens"] + text + ENDS["siemens"])
    (tmp_path / "mill.toml").write_text(machine_text(more='[control]\nprobing = "beside"\n'))
    line = ("--set-up-zero", "--no-travel-check", "--calibration", "none")
    said = succeed(tmp_path / "a.mpf", "--machine", tmp_path / "mill.toml", *line, "-o", tmp_path / "b.mpf").shown
    assert "CYCLE978 probes: what it finds is taken to change no coordinate" in " ".join(said.split())
    said = refusal(tmp_path / "a.mpf", "--machine", "gantry", *line)
    assert "state --probing beside" in said


# ---- moves and texts whose control alone knows the meaning


def test_m92_leaves_its_axes_unknown():
    """A position of the machine manufacturer: Z is known again at Z+20, X and Y stay."""
    text = "L X+10 Y+10 Z+20 R0 FMAX\nL Z+0 R0 FMAX M92\nL X+30 R0 F300\nL Z+20\n"
    found = places(text, "heidenhain")
    assert [row[:2] for row in found] == [[110.0, 210.0], [130.0, 210.0], [130.0, 210.0]]
    assert found[-1][2] == 20.0
    with pytest.raises(UserError, match="an increment of Z needs a known start"):
        places(text.replace("L Z+20\n", "L IZ+20\n"), "heidenhain")
    with pytest.raises(UserError, match="M92 needs a straight line"):
        places(text.replace("L Z+0 R0 FMAX M92", "CC X+0 Y+0\nC X+10 Y+10 DR+ M92"), "heidenhain")


def test_a_comment_goes_on_behind_a_tilde():
    text = "; HOUSING, CLAMPED IN THE RIGHT ~\n  VICE\nL X+10 Y+10 Z+20 R0 FMAX\n"
    assert places(text, "heidenhain") == [[110.0, 210.0, 20.0]]
    with pytest.raises(UserError, match="may be a block that the control does not run"):
        places("; HOUSING ~\n L X+10 Y+10 Z+20\nL X+5\n", "heidenhain")


LISTS = {
    "DEF REAL POS[3]=(10,20,30)\nG90 G0 X=POS[0] Y=POS[1] Z=POS[2]\n": [110.0, 220.0, 30.0],
    "DEF REAL POS[3]=SET(10,20,30)\nG90 G0 X=POS[0] Y=POS[1] Z=POS[2]\n": [110.0, 220.0, 30.0],
    "DEF REAL POS[3]\nPOS[1]=(20,30)\nG90 G0 X=POS[0] Y=POS[1] Z=(POS[2])\n": [100.0, 220.0, 30.0],
    "SETMS(1)\nG90 G0 X10 Y20 Z30\nSETMS\nSPOS=90\nSPOSA=AC(10)\n": [110.0, 220.0, 30.0],
}


@pytest.mark.parametrize("text", LISTS)
def test_lists_of_values_and_master_spindles(text):
    assert places(text, "siemens")[-1] == LISTS[text]


@pytest.mark.parametrize(("length", "z"), [("kept", 140.0), ("suppressed", 100.0)])
def test_the_tool_length_in_machine_coordinates_of_siemens(length, z, tmp_path):
    """MD10760: Z100 of the machine is that of the tip of a tool of 40 mm, or of the spindle."""
    (tmp_path / "mill.toml").write_text(machine_text(more=f'[control]\ng53_tool_length = "{length}"\n'))
    setup = ncomp.set_up(tmp_path / "mill.toml", zero=True, tool_length=["T1=40"])
    text = "G71 G90 G17 G54\nT1 D1 M6\nG0 X10 Y10 Z50\nSUPA G0 Z100\nM30\n"
    done = ncomp.correct(text, tmp_path / "mill.toml", "none", dialect="siemens", setup=setup, travel_check=False)
    assert done.moves.machine_target[:, 2].tolist() == [90.0, z]


MACRO = (
    "O0001\nG21 G90 G17 G54\nG0 X0. Y0. Z20.\n#101=5.\nG65 P9810 Z5. F3000.\nG65 P9811 Z0. S1.\nG0 X0. Y0. Z20.\n"
    "G1 X10. F100\nM30\n"
)


def test_macros_for_probes_in_other_memories():
    """G65 P9810 is in no file: where it ends is not known, and #101 may be another one behind it."""
    setup = ncomp.set_up("gantry", work_offset=["G54=100,200,0"], probing="beside")
    done = ncomp.correct(MACRO, "gantry", "none", dialect="iso", setup=setup, travel_check=False)
    assert done.moves.machine_target[-2:].tolist() == [[100.0, 200.0, 20.0], [110.0, 200.0, 20.0]]
    for bad, reason in {
        MACRO.replace("X10.", "X#101"): "O9811 probes and may set it",
        MACRO.replace("G0 X0. Y0. Z20.\nG1", "G91 G0 Z2.\nG1"): "an increment of Z needs a known start",
        MACRO.replace("P9811", "P8811"): "subprogram O8811",
    }.items():
        with pytest.raises(UserError, match=reason):
            ncomp.correct(bad, "gantry", "none", dialect="iso", setup=setup, travel_check=False)


def test_a_turn_the_long_way_is_noted(tmp_path):
    """C350 to C0 as it is written is 350 degrees back; 320 degrees, and increments, are meant."""
    axes = machine_text("w C b X Y Z t").replace("[axes.C]\n", '[axes.C]\nrollover = "as-written"\n')
    (tmp_path / "mill.toml").write_text(axes)
    text = "G21 G90 G17 G54\nG0 X0. Y0. Z5. C350.\nG1 X5. C0. F100\nX6. C320.\nG91 C350.\nM2\n"
    (tmp_path / "a.nc").write_text(text)
    line = ("check", tmp_path / "a.nc", "--machine", tmp_path / "mill.toml", "--set-up-zero", "--no-travel-check")
    said = " ".join(succeed(*line).shown.split())
    assert "C turns by 350 degrees in a feed move, and the shortest way would be 10 degrees back" in said
    assert said.count("check that the move is meant (line 3)") == 1


GUD = "%_N_UGUD_DEF\n;$PATH=/_N_DEF_DIR\nDEF CHAN REAL LAYER[2]\nDEF NCK SYNR INT COUNT = 7 ; parts\nM17\n"


def test_variables_of_the_control(tmp_path):
    """A GUD is known where the program has set it, also in a subprogram, whatever its first value."""
    (tmp_path / "ugud.def").write_text(GUD)
    text = "G90 G0 X0 Y0 Z5\nLAYER[1]=4\nCOUNT=2.6\nPART\nM30\n%_N_PART_SPF\nG1 X=LAYER[1] Y=COUNT F100\nM17\n"
    found = places(text, "siemens", definitions=[tmp_path / "ugud.def"])
    assert found[-1] == [104.0, 203.0, 5.0]
    for bad, reason in {
        "G90 G0 X=LAYER[0]\n": r"LAYER\[0\] has a value on the control, which is not known",
        "LAYER[2]=5\n": r"LAYER\[2\] is no element of LAYER\[2\]",
        "LAYERS=5\n": "definitions= gives the variables of the control",
    }.items():
        with pytest.raises(UserError, match=reason):
            places(bad, "siemens", definitions=[tmp_path / "ugud.def"])


def test_files_of_definitions(tmp_path):
    (tmp_path / "a.mpf").write_text("G90 G71 G17 G54\nLAYER[1]=4\nG0 X=LAYER[1] Y0 Z0\nM30\n")
    (tmp_path / "ugud.def").write_text(GUD)
    line = (tmp_path / "a.mpf", "--machine", "gantry", "--set-up-zero", "--no-travel-check", "--calibration", "none")
    succeed(*line, "--definitions", tmp_path / "ugud.def", "-o", tmp_path / "b.mpf")
    job = 'machine = "gantry"\ncalibration = "none"\nset_up_zero = true\ndefinitions = ["ugud.def"]\n'
    (tmp_path / "job.toml").write_text(job + '[programs]\n"a.mpf" = "c.mpf"\n[correction]\ntravel_check = false\n')
    succeed(tmp_path / "job.toml")
    assert (tmp_path / "c.mpf").read_bytes() == (tmp_path / "a.mpf").read_bytes()
    for bad, reason in {
        "G1 X5": "expected DEF CHAN REAL NAME",
        "DEF CHAN REAL": "is not",
        "DEF CHAN REAL R": "address",
    }.items():
        (tmp_path / "ugud.def").write_text(bad + "\n")
        said = " ".join(refusal(*line, "--definitions", tmp_path / "ugud.def").split())
        assert "ugud.def:1" in said
        assert reason in said
    assert "none.def" in refusal(*line, "--definitions", tmp_path / "none.def")
