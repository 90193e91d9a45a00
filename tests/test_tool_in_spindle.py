"""G43 H0: the tool in the spindle on LinuxCNC, tool 0 with a random tool changer, no length elsewhere."""

import pytest
from clients.rs274 import Tool
from support.command import refusal, succeed
from support.machine_texts import machine_text

import ncomp

MACHINE = machine_text(more="[control]\n")
LINUXCNC, RANDOM = 'family = "linuxcnc"\n', 'family = "linuxcnc"\nrandom_toolchanger = true\n'
HEAD, TAIL = "G21 G90 G54\n", "G0 X0 Y0 Z0\nM2\n"
LENGTHS = {1: 10.0, 2: 25.0}
BLOCKS = {
    "the tool in the spindle": "T1 M6\nG43 H0\n",
    "after another length": "T1 M6\nG43 H2\nG43 H0\n",
    "a tool that is selected only": "T1 M6\nT2\nG43 H0\n",
    "before any change": "G43 H0\n",
    "without H before any change": "T1\nG43\n",
    "an emptied spindle": "T1 M6\nT0 M6\nG43 H0\n",
    "a later change keeps the length": "T1 M6\nG43 H0\nT2 M6\n",
    "cancelled": "T1 M6\nG43 H0\nG49\n",
}


@pytest.fixture
def workshop(tmp_path):
    """Writes machine file and program, and returns the arguments of a command for them."""

    def written(control, text, *lengths):
        (tmp_path / "mill.toml").write_text(MACHINE + control)
        (tmp_path / "a.nc").write_text(HEAD + text + TAIL)
        tools = [word for tool, length in lengths for word in ("--tool-length", f"T{tool}={length}")]
        return [
            *(tmp_path / "a.nc", "--machine", tmp_path / "mill.toml", "--calibration", "none", *tools),
            *("--work-offset", "G54=0,0,0", "-o", tmp_path / "out.nc"),
        ]

    return written


def end(workshop, control, text):
    """Machine position of Z at the end, and everything that the run shows."""
    arguments = workshop(control, text, *LENGTHS.items())
    shown = succeed(*arguments).shown
    folder = arguments[0].parent
    setup = ncomp.set_up(
        str(folder / "mill.toml"), work_offset=["G54=0,0,0"], tool_length=[f"T{t}={v}" for t, v in LENGTHS.items()]
    )
    done = ncomp.correct(str(arguments[0]), str(folder / "mill.toml"), "none", setup=setup)
    return float(done.moves.machine_target[-1, 2]), shown


@pytest.mark.parametrize("case", BLOCKS)
def test_the_length_is_that_of_linuxcnc(case, workshop, linuxcnc):
    result = linuxcnc.run(HEAD + BLOCKS[case] + TAIL, tools={tool: Tool(length) for tool, length in LENGTHS.items()})
    assert result.exit_status == 0, result.message
    z, _ = end(workshop, LINUXCNC, BLOCKS[case])
    assert z == result.moves[-1].machine[2]


def test_the_assumption_is_shown(workshop):
    _, shown = end(workshop, LINUXCNC, BLOCKS["the tool in the spindle"])
    assert "G43 H0 is taken to select the length of the tool in the spindle (line 3)" in shown
    _, shown = end(workshop, LINUXCNC, BLOCKS["before any change"])
    assert "which is taken to be empty before the first tool change (line 2)" in shown


def test_other_controls_take_no_length(workshop):
    assert end(workshop, 'family = "fanuc"\n', BLOCKS["the tool in the spindle"])[0] == 0.0


def test_a_random_tool_changer_has_a_tool_0(workshop):
    text = BLOCKS["the tool in the spindle"]
    assert "length of tool T0 is not given" in refusal(*workshop(RANDOM, text, (1, 10.0)))
    done = succeed(*workshop(RANDOM, text, (0, 5.0), (1, 10.0)))
    assert "T0: 5" in done.shown
    assert "T1: 10" not in done.shown


def test_a_random_tool_changer_is_never_empty(workshop):
    said = refusal(*workshop(RANDOM, "G43\n", (0, 5.0), (1, 10.0)))
    assert "a tool is in the spindle before the first tool change" in said


@pytest.mark.parametrize("change", ["T1 M6 G43 H0\n", "G43 H0 T1 M6\n", "M61 Q1 G43 H0\n"])
def test_the_block_of_a_tool_change_selects_the_tool_before_it(change, workshop, linuxcnc):
    """LinuxCNC reads the length before the change, which is hardly meant: a refusal."""
    tools = {tool: Tool(length) for tool, length in LENGTHS.items()}
    result = linuxcnc.run(HEAD + "T2 M6\n" + change + TAIL, tools=tools)
    assert result.exit_status == 0, result.message
    assert result.moves[-1].machine[2] == LENGTHS[2]
    said = refusal(*workshop(LINUXCNC, "T2 M6\n" + change, *LENGTHS.items()))
    assert "write G43 H0 in the next block" in " ".join(said.split())
    z, _ = end(workshop, LINUXCNC, "T2 M6\n" + change.replace("G43 H0", "G43 H1"))
    assert z == LENGTHS[1]
