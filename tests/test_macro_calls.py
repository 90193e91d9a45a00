"""ISO programs that call macros behind moves (G66, G67), return to a block (M99 P), and number blocks per program."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.programs import correct, load, model_of, random_model, read, setup_of, shifted, source_of, written_out

from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.correct.check import check
from postproc.dialects import find_dialect

HEAD = "G21 G90 G54 G0 X0. Y0. Z0.\n"
SHIFT = {"X": 3.0, "Y": -4.2, "Z": 5.5}
BOWED = model_of(load("gantry"), ErrorMotion("Y", "X", Polynomial((0.0, 5000.0), 2), (0.0, -400.0, 400.0)))


def places(text):
    """X and Z after each move but that of the head."""
    motions = read(HEAD + text, load("gantry"))
    columns = [load("gantry").index(axis) for axis in "XZ"]
    return [tuple(round(float(v), 9) + 0.0 for v in row) for row in motions.target[1:, columns]]


HOLE = "O7\nG91 Z-#26\nZ#26\nG90\nM99\n"
RUNS = {
    "behind every move": (
        "G66 P7 Z5.\nX10.\nM8\nG4 P1\n(A COMMENT)\nX20.\nG67\nX30.\nM30\n" + HOLE,
        [(10, 0), (10, -5), (10, 0), (20, 0), (20, -5), (20, 0), (30, 0)],
    ),
    "passes": (
        "G66 P7 L2 Z5.\nX10.\nG67\nM30\n" + HOLE,
        [(10, 0), (10, -5), (10, 0), (10, -5), (10, 0)],
    ),
    "arguments as they are at G66": (
        "#100=4\nG66 P7 Z#100\n#100=9\nX10.\nG67\nG66 P7 Z#100\nX20.\nG67\nM30\n" + HOLE,
        [(10, 0), (10, -4), (10, 0), (20, 0), (20, -9), (20, 0)],
    ),
    "variables of its own": (
        "#1=3\nG66 P7 Z5.\nX10.\nG67\nX[#1]\nM30\nO7\n#1=8\nG91 Z-[#26+#1]\nG90\nM99\n",
        [(10, 0), (10, -13), (3, -13)],
    ),
    # 1-1 2-1 1-2 3-1 2-1 3-2 2-1 1-3: the moves of the later macro call the earlier one, whose own moves call none
    "one in the other": (
        "G66 P91\nX10.\nG66 P92\nX15.\nG67\nG67\nX-25.\nM30\nO91\nX50.\nM99\nO92\nX60.\nX70.\nM99\n",
        [(x, 0) for x in (10, 50, 15, 60, 50, 70, 50, -25)],
    ),
    "only the later one ended": (
        "G66 P91\nG66 P92\nX15.\nG67\nX16.\nG67\nM30\nO91\nX50.\nM99\nO92\nX60.\nM99\n",
        [(x, 0) for x in (15, 60, 50, 16, 50)],
    ),
    "places in a subprogram": (
        "G66 P7 Z5.\nM98 P8\nG67\nX30.\nM30\nO8\nX10.\nX20.\nM99\n" + HOLE,
        [(10, 0), (10, -5), (10, 0), (20, 0), (20, -5), (20, 0), (30, 0)],
    ),
    "within a macro": (
        "G65 P8 A2.\nX30.\nM30\nO8\nG66 P7 Z[#1+1]\nX10.\nG67\nX20.\nM99\n" + HOLE,
        [(10, 0), (10, -3), (10, 0), (20, 0), (30, 0)],
    ),
    "a macro that calls macros": (
        "G66 P8 Z5.\nX10.\nG67\nM30\nO8\nG65 P7 Z[#26/2]\nM99\n" + HOLE,
        [(10, 0), (10, -2.5), (10, 0)],
    ),
    "behind a loop's moves": (
        "#1=1\nG66 P7 Z5.\nWHILE[#1 LE 2]DO1\nX[#1*10]\n#1=#1+1\nEND1\nG67\nM30\n" + HOLE,
        [(10, 0), (10, -5), (10, 0), (20, 0), (20, -5), (20, 0)],
    ),
    "behind a circle": (
        "G66 P7 Z5.\nG2 I5. F100\nG67\nM30\nO7\nG91 G1 Z-#26\nG90 G0\nM99\n",
        [(0, 0), (0, -5)],
    ),
    "no macro to end": ("G67 X10.\nN5 G67\nX20.\n", [(10, 0), (20, 0)]),
    "dots behind codes": ("G66. P7 Z5.\nX10.\nG67.0\nX30.\nM30\n" + HOLE, [(10, 0), (10, -5), (10, 0), (30, 0)]),
    "back to a block": (
        "M98 P7\nX99.\nN20 X20.\nM30\nO7\nX1.\nM99 P20\n",
        [(1, 0), (20, 0)],
    ),
    "back before the call": (
        "#100=0\nN10 X#100\n#100=#100+1\nIF[#100 GE 2]GOTO 30\nG65 P7 A10.\nX99.\nN30 X30.\nM30\nO7\nX50.\nM99 P#1\n",
        [(0, 0), (50, 0), (1, 0), (30, 0)],
    ),
    "back to a number that both programs have": (
        "M98 P7\nX99.\nN20 X20.\nM30\nO7\nGOTO 20\nX98.\nN20 X1.\nM99 P20\n",
        [(1, 0), (20, 0)],
    ),
    "back through two subprograms": (
        "M98 P7\nX40.\nM30\nO7\nM98 P8\nX99.\nN5 X5.\nM99\nO8\nX8.\nM99 P5\n",
        [(8, 0), (5, 0), (40, 0)],
    ),
    "a jump in the main program": (
        "#1=0\nN10 X#1\n#1=#1+1\nIF[#1 GE 2]GOTO 20\nM99 P10\nN20 X20.\nM30\n",
        [(0, 0), (1, 0), (20, 0)],
    ),
    "numbers per program": (
        "GOTO 10\nX99.\nN10 X10.\nM98 P7\nM30\nO7\nGOTO 10\nX98.\nN10 X7.\nM99\n",
        [(10, 0), (7, 0)],
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_which_blocks_run(name):
    text, expected = RUNS[name]
    np.testing.assert_allclose(places(text), expected, atol=1e-9)


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("size", [1, 2])
def test_chunks_run_as_the_whole(monkeypatch, name, size):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    text, expected = RUNS[name]
    np.testing.assert_allclose(places(text), expected, atol=1e-9)


@pytest.mark.parametrize("name", RUNS)
def test_with_a_constant_error_every_move_goes_by_it(name):
    text, machine = HEAD + RUNS[name][0], load("gantry")
    written = correct(text, machine, shifted(machine, **SHIFT), travel_check=False).text
    before, after = read(text, machine).target, read(written, machine).target
    np.testing.assert_allclose(after - before, np.broadcast_to([-0.003, 0.0042, -0.0055], before.shape), atol=1e-9)
    calls = [
        [line for line in program.splitlines() if line.startswith(("G66", "M98", "M99", "O"))]
        for program in (text, written)
    ]
    assert calls[0] == calls[1]
    assert correct(text, machine, travel_check=False).text == text


@pytest.mark.parametrize("name", RUNS)
def test_written_out(name):
    """The same moves one after the other, without calls; the run compares them in every axis."""
    machine, dialect, text = load("gantry"), find_dialect("iso", "", ""), HEAD + RUNS[name][0]
    program = written_out(source_of(text), dialect, machine, setup_of(machine))
    out = program.source.data.decode()
    assert sum(len(part.motions) for part in program.parts()) == len(read(text, machine))
    assert not any(word in out for word in ("G66", "G67", "M99", "GOTO"))
    np.testing.assert_allclose(read(out, machine).target, read(text, machine).target, atol=1e-9)


def test_no_block_of_ours_calls_the_macro():
    """A long move is cut elsewhere; where a macro runs behind every move it stays whole."""
    machine = load("gantry")
    modal = HEAD + "G66 P7 Z5.\nG1 X1000. F500\nG67\nM30\n" + HOLE
    plain = HEAD + "G1 X1000. F500\nM30\n"
    written = [correct(text, machine, BOWED, travel_check=False, tolerance_um=1.0).text for text in (modal, plain)]
    added = [
        len(text.splitlines()) - len(other.splitlines()) for text, other in zip(written, (modal, plain), strict=True)
    ]
    assert added[1] > 3
    assert added[0] == 1  # the mark
    assert len(read(written[0], machine)) == len(read(modal, machine))


def test_a_reversal_of_play_within_a_modal_call_is_taken_up_on_the_way():
    """Taking it up needs a move of ncomp's own, behind which the macro would run."""
    machine = load("gantry")
    model = model_of(machine, Backlash("X", 30.0))
    moves, body = "G1 X5. F100\nX-5.\n", "M30\nO7\nG91 G1 Z-#26\nG90\nM99\n"
    assert "TAKE-UP" in correct(HEAD + moves + body, machine, model, travel_check=False).text
    result = correct(HEAD + "G66 P7 Z5.\n" + moves + "G67\n" + body, machine, model, travel_check=False)
    assert "TAKE-UP" not in result.text
    assert "X-5.0150" in result.text
    assert any("the backlash of X is taken up along a feed move" in note for note in result.report.notes)


@given(st.lists(st.tuples(st.integers(1, 400), st.booleans()), min_size=1, max_size=6), st.integers(1, 3))
def test_as_if_called_by_hand(moves, passes):
    """G66 runs what G65 behind each block would."""
    body = "M30\nO7\nG91 G1 Z-#26 F100\nG0 Z#26\nG90\nM99\n"
    places_ = list(dict.fromkeys(x for x, _ in moves))
    modal = HEAD + f"G66 P7 L{passes} Z5.\n" + "".join(f"G0 X{x}.\nM8\n" for x in places_) + "G67\n" + body
    by_hand = HEAD + "".join(f"G0 X{x}.\nG65 P7 L{passes} Z5.\nM8\n" for x in places_) + body
    machine = load("gantry")
    np.testing.assert_array_equal(read(modal, machine).target, read(by_hand, machine).target)


REFUSED = {
    "G66": (2, "G66 needs P, the number of the program"),
    "G66 P7": (2, "the file has no subprogram O7"),
    "G66 P7 X1. X2.": (2, "the call has two words of one address"),
    "G66 P7 M98": (2, "must be the only call, jump or loop of its block"),
    "G66.1 P7": (2, "G66.1 calls a macro after every block"),
    "/G66 P7": (2, "the block-skip switch decides whether this block runs"),
    "G[66] P7": (2, "G66 calls a macro"),
    "G[67]": (2, "G67 is not known"),
    "G66 P7\nX10. G67\nM30\nO7\nM99": (3, "a move in one block with a jump, a call or an end is not corrected while G66 is active"),
    "G66 P7\nX10. M98 P7\nM30\nO7\nM99": (3, "a move in one block with a jump, a call or an end is not corrected while G66 is active"),
    "G66 P7\nX10. M30\nO7\nM99": (3, "a move in one block with a jump, a call or an end is not corrected while G66 is active"),
    "G66 P7\nX0.\nM30\nO7\nM99": (3, "the block moves to the present position while G66 is active"),
    "G66 P7\nG28 Z0\nM30\nO7\nM99": (3, "G28 while G66 is active"),
    "G66 P7\nG53 X5.\nM30\nO7\nM99": (3, "G53 while G66 is active"),
    "G66 P7\nG49\nM30\nO7\nM99": (3, "a length offset without coordinates while G66 is active"),
    "G66 P7\nG98 G81 X5. Z-5. R-1. F100\nM30\nO7\nM99": (3, "a canned cycle while G66 is active"),
    "G66 P7\nG41 D1 X5.\nM30\nO7\nM99": (3, "radius compensation while G66 is active"),
    "G66 P7\nG65 P8\nM30\nO7\nM99\nO8\nM99": (3, "not all controls run the modal macro after the moves of this macro"),
    "G66 P7\nX5.\nM30\nO7\nG66 P8\nM99\nO8\nM99": (6, "G66 in a modal macro is not corrected"),
    "G66 P7\nX5.\nM30\nO7\nG67\nM99": (6, "G67 and its G66 are in different programs"),
    "G66 P7\nM98 P8\nM30\nO7\nM99\nO8\nG67\nM99": (8, "G67 and its G66 are in different programs"),
    "M98 P8\nM30\nO7\nM99\nO8\nG66 P7\nM99": (2, "the subprogram ends while its G66 is active"),
    "G66 P7 Z5\nX5.\nM30\nO7\nZ-#26\nM99": (6, "the unit of an argument without decimal point is not known"),
    "G66 P7 Z5.\nX5.\nX6.\nM30\nO7\nG91 Z-#26\n#26=#26+1\nG90\nM99": (7, "a repeated macro begins with the values of its call on some controls"),
    "G66 P7\nX5.\nX6.\nM30\nO7\nIF[#100 EQ 1]GOTO 5\n#1=2\n#100=1\nN5 Z#1\nM99": (7, "#100 is not set"),
    "#100=0\nG66 P7\nX5.\nX6.\nM30\nO7\nIF[#100 EQ 1]GOTO 5\n#1=2\n#100=1\nN5 Z#1\nM99": (11, "a repeated macro begins with the values of its call on some controls"),
    "G65 P7 L2 A1.\nM30\nO7\nX#1\n#1=#1+1\nM99": (5, "a repeated macro begins with the values of its call on some controls"),
    "G66 P7\nX5.\nN9 M30\nO7\nM99 P9": (6, "M99 with P is not corrected in a repeated subprogram or in a modal macro"),
    "M98 P7 L2\nN9 M30\nO7\nM99 P9": (5, "M99 with P is not corrected in a repeated subprogram"),
    "M98 P7\nM30\nO7\nN9\nM99 P9": (6, "the program has no block with the label 9"),
    "M98 P7\nN9\nN9\nM30\nO7\nM99 P9": (7, "2 blocks have the label 9"),
    "M99 P9": (2, "the program has no block with the label 9"),
    "M99 P#9": (2, "#9 is not set by the program"),
    "M99 P9 L2": (2, "M99 with L or Q"),
    "GOTO 9\nM30\nO7\nN9 M99": (2, "the program has no block with the label 9"),
    "M98 P7\nN9 M30\nO7\nGOTO 9\nM99": (5, "the program has no block with the label 9"),
}  # fmt: skip


@pytest.mark.parametrize("block", REFUSED)
def test_refused(block):
    line, reason = REFUSED[block]
    with pytest.raises(UserError, match=rf"^test\.nc:{line}: ") as caught:
        read(HEAD + block + "\n", load("gantry"))
    assert reason in str(caught.value)


@pytest.mark.parametrize("block", ["N5 X1.\nX2.\nM99 P5", "G66 P7\nN5 X1.\nX2.\nGOTO 5\nM30\nO7\nZ1.\nM99"])
def test_what_never_ends_is_refused(block):
    with pytest.raises(UserError, match="runs the same blocks with the same values for ever"):
        read(HEAD + block + "\n", load("gantry"))


def test_what_a_check_tells():
    machine = load("gantry")
    source = source_of(HEAD + RUNS["behind every move"][0])
    findings = check(source, find_dialect("iso", "", ""), machine, make_setup(machine, zero=True), travel_check=False)
    assert not findings.refused
    assert findings.repeated == [12, 13]


def test_a_macro_at_places_that_want_different_corrections():
    """Increments take none; a depth said in the macro would be another at every place."""
    machine = load("gantry")
    text = HEAD + "G66 P7\nX100.\nX500.\nG67\nM30\nO7\nZ-5.\nZ0.\nM99\n"
    with pytest.raises(UserError, match="this block runs more than once and needs a different correction each time"):
        correct(text, machine, random_model(machine, 3), travel_check=False)
