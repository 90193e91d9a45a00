"""The set-up is never guessed: work offsets and tool lengths are given, assumed and named, or refused."""

import json
import re
from pathlib import Path

import pytest

import machines
from kinematics.user_error import UserError

ISO = "G21 G90 G17 G54\nT1 M6\nG43 H1 G0 X1.0 Y2.0 Z3.0\nG1 X20.0 F500\nM30\n"
SIEMENS = "G54 T1 D1 M6\nG0 X1 Y2 Z3\nG1 X20 F500\nM30\n"
KLARTEXT = "BEGIN PGM P MM\nTOOL CALL 1 Z S2000\nL X+1 Y+2 Z+3 FMAX\nL X+20 F500\nM30\nEND PGM P MM\n"
PROGRAMS = {"p.nc": ("G54", ISO), "p.mpf": ("G54", SIEMENS), "p.h": ("0", KLARTEXT)}
OWN = """name = "own"
chain = "w b X Y Z t"
[axes.X]
travel = [-500, 500]
[axes.Y]
travel = [-500, 500]
[axes.Z]
travel = [0, 900]
"""


@pytest.fixture(autouse=True)
def programs(tmp_path):
    """A program in each dialect, and a user's machine that gives no work offset and no tool."""
    (tmp_path / "own.toml").write_text(OWN)
    for name, (_, text) in PROGRAMS.items():
        (tmp_path / name).write_text(text)


ALONE = ("--machine", "own.toml", "--calibration", "none")


# ---- refused, given, zero on purpose

NAMED = {
    "p.h": ("0", 'BEGIN PGM P MM\nTOOL CALL "Mill_10" Z S1000\nL X+1 Y+2 Z+3 R0 FMAX\nL X+20 F500\nEND PGM P MM\n'),
    "p.mpf": ("G54", 'G54\nT="Mill_10"\nM6 D1\nG0 X1 Y2 Z3\nG1 X20 F500\nM30\n'),
}


@pytest.mark.parametrize("name", NAMED)
def test_a_tool_that_has_a_name(name, command):
    offset, text = NAMED[name]
    Path(name).write_text(text)
    given = (name, *ALONE, "--work-offset", f"{offset}=0,0,100", "-o", "out", "--json", "-")
    done = command(*given)
    assert done.status == 2
    assert "length of tool MILL_10 is not given; give it by --tool-length MILL_10=mm, " in done.err
    for option, length in ((("--tool-length", "mill_10=80.5"), "80.5"), (("--set-up-zero",), "0 (--set-up-zero)")):
        done = command(*given, *option)
        assert done.status == 0
        assert json.loads(done.out)["tools"] == {"MILL_10": length}
    assert "tool MILL_10 are assumed" in command(name, "--machine", "dmu50", "-o", "out").err
    twice = ("--tool-length", "Mill_10=80", "--tool-length", "MILL_10=80")
    assert "--tool-length MILL_10 is given twice" in command(*given, *twice).err


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_work_offset_that_nobody_gave_is_refused(name, command):
    offset, line = PROGRAMS[name][0], 3 if name != "p.mpf" else 2
    done = command(name, *ALONE, "--tool-length", "T1=80", "-o", "out.nc")
    assert done.status == 2
    assert f"{name}:{line}: " in done.err
    assert f"work offset {offset} is not given; give it by --work-offset {offset}=x,y,z, " in done.err
    assert "--set-up-zero" in done.err
    assert not Path("out.nc").exists()


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_tool_length_that_nobody_gave_is_refused(name, command):
    done = command(name, *ALONE, "--work-offset", f"{PROGRAMS[name][0]}=0,0,100", "-o", "out.nc")
    assert done.status == 2
    assert "length of tool T1 is not given; give it by --tool-length T1=mm, " in done.err
    assert not Path("out.nc").exists()


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("tool", [("--tool-length", "T1=80"), ("--tool-table", "tools.json")])
def test_given_by_options_and_tables(name, tool, command):
    Path("tools.json").write_text('{"1": 80}')
    offset, text = PROGRAMS[name]
    done = command(name, *ALONE, "--work-offset", f"{offset}=0,0,100", *tool, "-o", "out", "--json", "-")
    assert done.status == 0
    found = json.loads(done.out)
    assert (found["work_offsets"], found["tools"]) == ({offset: "X 0, Y 0, Z 100"}, {"1": "80"})
    assert found["assumed"] == []
    assert Path("out").read_text() == text


@pytest.mark.parametrize("name", PROGRAMS)
def test_given_in_the_machine_file(name, command):
    offset, _ = PROGRAMS[name]
    Path("own.toml").write_text(f"{OWN}[work_offsets]\n{offset} = {{X = 1, Y = 2, Z = 100}}\n[tools]\n1 = 80\n")
    done = command(name, *ALONE, "-o", "out", "--json", "-")
    found = json.loads(done.out)
    assert (found["work_offsets"], found["tools"]) == ({offset: "X 1, Y 2, Z 100"}, {"1": "80"})
    assert "assumed" not in done.err


@pytest.mark.parametrize("name", PROGRAMS)
def test_zero_on_purpose(name, command):
    done = command(name, *ALONE, "--set-up-zero", "-o", "out", "--json", "-")
    assert done.status == 0
    found = json.loads(done.out)
    assert found["work_offsets"] == {PROGRAMS[name][0]: "0 (--set-up-zero)"}
    assert found["tools"] == {"1": "0 (--set-up-zero)"}
    assert found["assumed"] == []


def test_zero_on_purpose_leaves_what_was_given(command):
    given = ("--work-offset", "G54=1,2,3", "--tool-length", "T1=7")
    found = json.loads(command("p.nc", *ALONE, "--set-up-zero", *given, "-o", "out", "--json", "-").out)
    assert (found["work_offsets"], found["tools"]) == ({"G54": "X 1, Y 2, Z 3"}, {"1": "7"})


USES_NOTHING = {
    "machine zero, ISO": ("a.nc", "G21 G90 G17\nG53 G0 Z10.0\nG53 X1.0 Y1.0\nG28\nM30\n"),
    "a tool that is called and moves nothing": ("a.nc", "G21 G90 G17\nT1 M6\nT2 M6\nG53 G0 Z10.0\nM30\n"),
    "machine zero, Siemens": ("a.mpf", "G500 D0\nG0 X1 Y2 Z3\nSUPA G0 Z10\nM30\n"),
    "SUPA, Siemens": ("a.mpf", "G54 D0\nG0 SUPA X1 Y2 Z3\nM30\n"),
    "machine coordinates, Klartext": ("a.h", "BEGIN PGM A MM\nTOOL CALL 1 Z\nL X+1 Y+1 Z+500 FMAX M91\nEND PGM A MM\n"),
    "the program sets its offset, ISO": ("a.nc", "G21 G90 G17\nG10 L2 P1 X1. Y2. Z3.\nG54 G0 X1. Y1. Z1.\nM30\n"),
    "the program sets its offset, Siemens": ("a.mpf", "$P_UIFR[1]=CTRANS(X,1,Y,2,Z,3)\nG54 G0 X1 Y1 Z1\nM30\n"),
    "the program sets its tool": ("a.mpf", "$TC_DP3[1,1]=80\nT1 D1 M6\nG500 G0 X1 Y1 Z1\nM30\n"),
    "tool 0": ("a.nc", "G21 G90 G17\nG10 L2 P1 X1. Y2. Z3.\nG49 G54 G0 X1. Y1. Z1.\nM30\n"),
}


@pytest.mark.parametrize(("name", "text"), USES_NOTHING.values(), ids=USES_NOTHING)
def test_programs_that_use_no_offset_and_no_tool_of_the_set_up(name, text, command):
    Path(name).write_text(text)
    done = command(name, *ALONE, "-o", "out")
    assert done.status == 0, done.err
    assert "assumed" not in done.err


NOT_ENOUGH = {
    "one axis of three, G10": ("a.nc", "G21 G90 G17\nG10 L2 P1 X1.\nG54 G0 X1. Y1. Z1.\n", "work offset G54"),
    "one axis of three, Siemens": ("a.mpf", "$P_UIFR[1,X,TR]=1\nG54 G0 X1 Y1 Z1\n", "work offset G54"),
    "fine offsets alone": (
        "a.mpf", "$P_UIFR[1,X,FI]=1\n$P_UIFR[1,Y,FI]=1\n$P_UIFR[1,Z,FI]=1\nG54 G0 X1 Y1 Z1\n", "work offset G54",
    ),
    "none named, Siemens": ("a.mpf", "G0 X1 Y1 Z1\n", "work offset G500"),
    "a second one": ("a.nc", "G21 G90 G17\nG10 L2 P1 X1. Y2. Z3.\nG54 G0 X1. Y1. Z1.\nG55 X1.\n", "work offset G55"),
    "under TCP": ("a.mpf", "$P_UIFR[1]=CTRANS(X,1)\nT3 D1 M6\nTRAORI\nG54 G0 X1 Y1 Z1\n", "length of tool T3"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "text", "what"), NOT_ENOUGH.values(), ids=NOT_ENOUGH)
def test_what_is_given_in_part_is_refused(name, text, what, command):
    Path(name).write_text(text)
    done = command(name, *ALONE, "-o", "out")
    assert done.status == 2
    assert f"{what} is not given" in done.err


def test_wear_without_a_length_is_refused(command):
    Path("a.mpf").write_text("$TC_DP12[1,1]=0.1\nT1 D1 M6\nG500 G0 X1 Y1 Z1\n")
    done = command("a.mpf", *ALONE, "--tool-length", "T1=80", "-o", "out")
    assert done.status == 2
    assert (
        "a.mpf:2: 'T1 D1 M6': the program sets wear or base of tool 1 without its length: set the length ($TC_DP3) too"
        in done.err
    )


def test_refused_with_a_loop_and_unrolled(command):
    Path("a.mpf").write_text("FOR R1=1 TO 2\nG54 G0 X1 Y1 Z=R1\nENDFOR\n")
    for more in ((), ("--unroll",)):
        done = command("a.mpf", *ALONE, *more, "-o", "out")
        assert done.status == 2
        assert "a.mpf:2: 'G54 G0 X1 Y1 Z=R1': work offset G54 is not given" in done.err


# ---- assumed by the machine file


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("machine", machines.names())
def test_shipped_machines_assume_a_part_in_the_middle_of_the_table(name, machine, command):
    offset, text = PROGRAMS[name]
    done = command(name, "--machine", machine, "--calibration", "none", "-o", "out", "--json", "out.json")
    assert done.status == 0, done.err
    assert Path("out").read_text() == text
    found, first = json.loads(Path("out.json").read_text()), done.err.splitlines()[0]
    assert first.startswith(f"Work offset {offset} and tool T1 are assumed: {offset} X ")
    assert first.endswith("; T1 100 mm; give --work-offset / --tool-length")
    assert found["assumed"] == [f"work offset {offset}", "tool T1"]
    assert found["work_offsets"][offset].endswith(" (assumed)")


def test_axes_that_a_work_offset_leaves_out_are_named(command):
    """Zero for them is documented, and seldom meant: `check` and the correction say so."""
    sentence = "work offset G54 does not give Y and Z: they count as 0"
    Path("p.nc").write_text(ISO.replace("Z3.0", "Z300.0"))
    given = ("--machine", "own.toml", "--tool-length", "T1=80")
    assert sentence in command("check", "p.nc", *given, "--work-offset", "G54=X=5").out.decode()
    assert sentence in command("p.nc", *given, "-c", "none", "--work-offset", "G54=X=5", "-o", "out").shown
    Path("job.toml").write_text(
        'machine = "own.toml"\n[work_offsets]\nG54 = { X = 5, Y = 0 }\n[tools]\n1 = 80\n[programs]\n"p.nc" = "out"\n'
    )
    assert "work offset G54 does not give Z: it counts as 0" in command("job.toml", "--check").out.decode()
    for whole in ("--work-offset", "G54=5,0,0"), ("--set-up-zero",):
        assert "does not give" not in command("check", "p.nc", *given, *whole).shown


def test_a_travel_refusal_before_the_first_tool_names_the_length_that_is_missing(command):
    """FreeCAD goes to the clearance height before the first tool change: Z then has no tool length."""
    Path("p.nc").write_text("G21 G90 G54\nG0 Z26\nT1 M6\nG43 H1\nG0 X1 Y2 Z30\nM30\n")
    given = ("--work-offset", "G54=0,0,-90", "--tool-length", "T1=80")
    done = command("check", "p.nc", "--machine", "own.toml", *given)
    assert "G54 = X 0, Y 0, Z -90 and no tool length in force: check these" in done.out.decode()


@pytest.mark.parametrize("machine", machines.names())
def test_assumed_offsets_leave_room(machine):
    """The middle of X and Y; 100 mm below the part and 100 mm above the nose of a tool of 100 mm that touches it."""
    found = machines.load(machine)
    offset = found.work_offsets["default"]
    for axis in "XY":
        assert offset[axis] == sum(found.axes[found.index(axis)].travel) / 2
    low, high = found.axes[found.index("Z")].travel
    assert low + 100.0 <= offset["Z"] <= high - found.tools["default"] - 100.0


def test_assumed_where_the_user_gives_a_part(command):
    done = command("p.nc", "--machine", "dmu50", "--work-offset", "G54=1,2,90", "-o", "out.nc")
    assert done.err.splitlines()[0] == "Tool T1 is assumed: T1 100 mm; give --tool-length"


def test_other_commands_say_what_is_assumed(command):
    sentence = "Work offset G54 and tool T1 are assumed: G54 X 0, Y 0, Z 100; T1 100 mm"
    command("p.nc", "--machine", "dmu50", "-o", "out.nc")
    assert command("verify", "p.nc", "out.nc", "--machine", "dmu50").err.splitlines()[0].startswith(sentence)
    found = command("check", "p.nc", "--machine", "dmu50")
    assert found.out.decode().startswith(sentence)
    assert json.loads(command("check", "p.nc", "--machine", "dmu50", "--json", "-").out)["assumed"] == [
        "work offset G54", "tool T1"
    ]  # fmt: skip


def test_the_report_page_says_what_is_assumed(command):
    command("p.nc", "--machine", "dmu50", "-o", "out.nc", "--report", "page.html")
    page = Path("page.html").read_text()
    assert "Work offset G54 and tool T1 are assumed" in page
    assert "(assumed)" in page


@pytest.mark.parametrize("arguments", [
    ("verify", "p.nc", "p.nc"), ("check", "p.nc"), ("fit", "data.csv", "--path", "p.nc", "-o", "cal.json"),
])  # fmt: skip
def test_other_commands_refuse_what_nobody_gave(arguments, command):
    Path("data.csv").write_text("# machine: own\ntime_s,x,y,z\n0,0,0,0\n")
    options = ALONE[:2] if arguments[0] != "verify" else ALONE
    done = command(*arguments, *options)
    assert done.status == 2
    assert "G54 is not given; give it by --work-offset G54=x,y,z" in done.err + done.out.decode()
    if arguments[0] != "fit":
        assert "not given" not in command(*arguments, *options, "--set-up-zero").err


MACHINE_FILES = {
    "default without assumed": (
        "[work_offsets]\ndefault = {X = 1}\n",
        "work_offsets.default holds for all names that are not given, which is an assumption: write assumed = true",
    ),
    "default tool without assumed": ("[tools]\ndefault = 1.0\n", "tools.default holds for all names that are not given"),
    "assumed is no word": ('[tools]\nassumed = "yes"\n', "tools.assumed: expected true or false, not a text in quotes"),
    "an axis that there is not": (
        "[work_offsets]\nassumed = true\ndefault = {C = 1}\n", "work_offsets.default: no axis C in the chain",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), MACHINE_FILES.values(), ids=MACHINE_FILES)
def test_machine_files_that_are_refused(text, message):
    with pytest.raises(UserError) as refusal:
        machines.parse(OWN + text, "own.toml")
    assert re.match(rf"machine file own\.toml:\d+: {re.escape(message)}", str(refusal.value))


def test_an_entry_by_name_comes_before_the_default(command):
    Path("own.toml").write_text(f"{OWN}[work_offsets]\nassumed = true\nG55 = {{Z = 5}}\ndefault = {{Z = 9}}\n")
    Path("a.nc").write_text("G21 G90 G17\nG54 G0 X1. Y1. Z1.\nG55 X1. Y1. Z1.\n")
    done = command("a.nc", *ALONE, "-o", "out")
    assert done.err.splitlines()[0] == (
        "Work offset G54 and work offset G55 are assumed: G54 Z 9; G55 Z 5; give --work-offset"
    )


def test_machines_shows_what_a_file_assumes(command):
    shown = command("machines", "dmu50").out.decode()
    assert "work offset  default: X 0, Y 0, Z 100 (assumed)" in shown
    assert "tool length  default: 100 mm (assumed)" in shown


def test_a_path_that_is_planned_along_a_program_needs_its_set_up(command):
    Path("path.nc").write_text("G21 G90 G54\nG0 X0 Y0 Z100\nG1 X100 F1000\nY100\nX0\nZ200\nX100\nY0\nX0\n")
    options = ("plan", "--strategy", "on-the-fly", "--path", "path.nc", "--target", "t=0,0,-100", "-o", "plan.csv")
    refused = command(*options, *ALONE[:2])
    assert refused.status == 2
    assert "work offset G54 is not given" in refused.err
    assert command(*options, *ALONE[:2], "--set-up-zero").status == 0
    assert command(*options, *ALONE[:2], "--work-offset", "G54=1,2,3").status == 0


# ---- travel


def test_travel_names_the_set_up_before_the_way_round_it(command):
    Path("a.nc").write_text("G21 G90 G17 G54\nT1 M6\nG43 H1 G0 X1. Y1. Z900.\n")
    done = command("a.nc", "--machine", "dmu50", "-o", "out.nc")
    assert done.status == 2
    assert (
        "outside its travel 0..400 with work offset G54 = X 0, Y 0, Z 100 (assumed) and tool T1 = 100 mm (assumed): "
        "check these (--work-offset, --tool-length, or their entries in the job or machine file); --no-travel-check lets it pass"
    ) in done.err


def test_check_looks_at_travel_as_correct_does(command):
    Path("a.nc").write_text("G21 G90 G17 G54\nG0 X1. Y1. Z900.\nX2.\nZ1.\nG53 G0 Z-1.\n")
    options = ("--machine", "dmu50", "--work-offset", "G54=0,0,0")
    corrected = command("a.nc", *options, "-o", "out.nc")
    checked = command("check", "a.nc", *options, "--json", "-")
    assert (corrected.status, checked.status) == (2, 2)
    refused = json.loads(checked.out)["refused"]
    assert [entry["line"] for entry in refused] == [2, 3, 5]
    assert f"{refused[0]['text']!r}: {refused[0]['reason']}" in corrected.err
    assert "work offset" not in refused[2]["reason"]
    passed = command("check", "a.nc", *options, "--no-travel-check", "--json", "-")
    assert passed.status == 0
    assert any(note.startswith("Z outside its travel") for note in json.loads(passed.out)["notes"])
    assert command("a.nc", *options, "--no-travel-check", "--accept", "outside", "-o", "out.nc").status == 0
