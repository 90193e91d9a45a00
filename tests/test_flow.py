"""Programs with variables, jumps, loops and subprograms: which block runs when, with which values, and what is written."""

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import correct, load, random_model, read, shifted
from support.tiers import drawn

from kinematics.user_error import UserError
from postproc.verification.verify import verify

HEAD = "G21 G90 G54 G0 X0. Y0. Z0.\n"
OFFSET = {"X": 3.0, "Y": -4.2, "Z": 5.5}
SHIFT = [-0.003, 0.0042, -0.0055]


def ends(text, axis="X"):
    """Positions of an axis after each move but those of the head."""
    motions = read(HEAD + text, load("gantry"))
    column = motions.target[:, load("gantry").index(axis)]
    return [round(float(value), 9) + 0.0 for value in column[1:]]


RUNS = {
    "values": ("#1=2 #2=3\nX#1\nX[#1+#2]\nX-#1\nX[-#1*#2]\nX##1\n", [2, 5, -2, -6, 3]),
    "functions": ("#1=30\nX[SIN[#1]*10]\nX[ATAN[1]/[1]]\nX[SQRT[16]+ABS[-1]]\nX[[2**3]**2]\nX[7 MOD 4]\n", [5, 45, 5, 64, 3]),
    "order": ("X[2+3*4]\nX[[2+3]*4]\nX[10-2-3]\nX[-2+3]\nX[2*-3]\nX[FIX[2.7]+FUP[2.1]]\n", [14, 20, 5, 1, -6, 5]),
    "names": ("#<a b>=4\nX#<AB>\n#<_cut>=5\nX#<_cut>\n", [4, 5]),
    "conditions": ("#1=1\nIF[#1 EQ 1] THEN #1=7\nIF[#1 NE 7] THEN #1=8\nX#1\n", [7]),
    "jumps": ("#1=0\nN10 X#1\n#1=#1+1\nIF[#1 LT 3]GOTO 10\nGOTO20\nX99.\nN20 X9.\n", [0, 1, 2, 9]),
    "computed jump": ("#1=20\nGOTO#1\nX1.\nN20 X2.\n", [2]),
    "loops": ("#1=0\nWHILE[#1 LT 2]DO1\n#2=0\nWHILE[#2 LT 2]DO2\nX[#1*10+#2]\n#2=#2+1\nEND2\n#1=#1+1\nEND1\n", [0, 1, 10, 11]),
    "sums of eighths": ("#1=0\nWHILE[#1 LT 1]DO1\n#1=#1+.125\nX#1\nEND1\n", [0.125 * n for n in range(1, 9)]),
    "subprograms": ("#1=5\nM98 P7 L2\nX0.\nM30\nO7\nX#1\n#1=#1+1\nM99\n", [5, 6, 0]),
    "macros": ("#1=5\nG65 P7 A1. X2.\nX#1\nM30\nO7\nX[#1+#24]\n#1=9\nM99\n", [3, 5]),
    "a call in a move": ("X1. M98 P7\nX3.\nM30\nO7\nX2.\nM99\n", [1, 2, 3]),
    "nested calls": ("M98 P7\nX3.\nM30\nO7\nM98 P8 L2\nX2.\nM99\nO8\nX1.\nM99\n", [1, 1, 2, 3]),
    "an end within": ("IF[1 EQ 1]GOTO5\nN4 X1.\nM30\nN5 X2.\nGOTO4\n", [2, 1]),
    "o-words": ("o1 sub\nX#1\nX#2\no1 endsub\no1 call [3] [4]\no1 call [5] [6]\n", [3, 4, 5, 6]),
    "o-word branches": (
        "#1=2\no1 if [#1 eq 1]\nX1.\no1 elseif [#1 eq 2]\nX2.\no1 else\nX3.\no1 endif\n"
        "o2 if [#1 gt 5]\nX4.\no2 else\nX5.\no2 endif\n", [2, 5],
    ),
    "o-word loops": (
        "#1=0\no1 while [#1 lt 2]\nX#1\n#1=[#1+1]\no1 endwhile\no2 do\nX#1\n#1=[#1-1]\no2 while [#1 gt 0]\n"
        "o3 repeat [2]\nX7.\no3 endrepeat\n", [0, 1, 2, 1, 7, 7],
    ),
    "leaving": (
        "#1=0\no1 while [#1 lt 9]\n#1=[#1+1]\no2 if [#1 eq 2]\no1 continue\no2 endif\no3 if [#1 gt 3]\no1 break\no3 endif\n"
        "X#1\no1 endwhile\n", [1, 3],
    ),
    "loops behind a break": (
        "#1=0\no1 while [#1 lt 3]\n#1=[#1+1]\no2 if [#1 eq 2]\no1 break\no2 endif\nX#1\no1 endwhile\n"
        "o3 do\nX#1\no3 while [#1 gt 9]\no4 do\nX#1\n#1=[#1+1]\no4 while [#1 lt 4]\n"
        "o5 do\nX7.\no5 break\no5 while [1 eq 1]\no6 do\nX#1\n#1=[#1+1]\no6 while [#1 lt 6]\n",
        [1, 2, 2, 3, 7, 4, 5],
    ),
    "returning": ("o1 sub\nX1.\no2 if [#1 eq 1]\no1 return\no2 endif\nX2.\no1 endsub\no1 call [1]\no1 call [2]\n", [1, 1, 2]),
    "recursion": ("o1 sub\no2 if [#1 gt 0]\nX#1\no1 call [#1-1]\no2 endif\nX[#1*10]\no1 endsub\no1 call [2]\n", [2, 1, 0, 10, 20]),
}  # fmt: skip
LINUXCNC_TOO = [
    name for name, (text, _) in RUNS.items() if not any(word in text for word in ("GOTO", "THEN", "DO1", "G65", "M98"))
]


@pytest.mark.parametrize("name", RUNS)
def test_which_blocks_run(name):
    text, expected = RUNS[name]
    assert ends(text) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("size", [1, 3])
def test_chunks_run_as_the_whole(monkeypatch, name, size):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    text, expected = RUNS[name]
    assert ends(text) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", RUNS)
def test_without_errors_the_bytes_stay(name):
    text = HEAD + RUNS[name][0]
    assert correct(text, load("gantry"), travel_check=False).text == text


@pytest.mark.parametrize("name", RUNS)
def test_with_a_constant_error_every_move_goes_by_it(name):
    """Also where one block runs at many places; the corrected text is read anew."""
    text, machine = HEAD + RUNS[name][0], load("gantry")
    model = shifted(machine, **OFFSET)
    written = correct(text, machine, model, travel_check=False).text
    before, after = read(text, machine).target, read(written, machine).target
    np.testing.assert_allclose(after - before, np.broadcast_to(SHIFT, before.shape), atol=1e-9)
    assert "\n".join(
        line for line in written.split("\n") if line.startswith(("#", "IF", "o", "G65", "M98"))
    ) == "\n".join(line for line in text.split("\n") if line.startswith(("#", "IF", "o", "G65", "M98")))


@pytest.mark.parametrize("name", LINUXCNC_TOO)
def test_linuxcnc_runs_them_alike(linuxcnc, name):
    text = HEAD + RUNS[name][0] + "M2\n"
    machine = load("gantry")
    written = correct(text, machine, shifted(machine, **OFFSET), travel_check=False).text
    for program in (text, written):
        seen = linuxcnc.run(program)
        assert seen.exit_status == 0, seen
        np.testing.assert_allclose([move.end[:3] for move in seen.moves], read(program, machine).target, atol=1e-6)


@pytest.mark.parametrize(
    ("block", "written"),
    [
        ("X#1", "X[#1-0.0030]"),
        ("X-#1", "X[-#1-0.0030]"),
        ("X[#1]", "X[#1-0.0030]"),
        ("X[#1*2]", "X[#1*2-0.0030]"),
        ("X [ #1 + 2 ]", "X [ #1 + 2 -0.0030]"),
        ("X[#1 GT 2]", "X[[#1 GT 2]-0.0030]"),
        ("X SIN[#1]", "X [SIN[#1]-0.0030]"),
        ("x#<depth>", "x[#<depth>-0.0030]"),
        ("X#1 Y5", "X[#1-0.0030] Y5.0042"),
        ("G91 X#1", "G91 X#1"),
        ("F#1 X#2", "F#1 X[#2-0.0030]"),
    ],
)
def test_what_is_added_to_a_formula(block, written):
    machine = load("gantry")
    text = f"{HEAD}#1=5\n#2=6\n#<depth>=7\n{block}\n"
    assert correct(text, machine, shifted(machine, **OFFSET), travel_check=False).text.splitlines()[-1] == written


def test_arcs_with_formulas(linuxcnc):
    machine = load("gantry")
    text = HEAD + "#1=10\n#2=5\nG1 X[#1*1] Y0. F500\nG2 X[#1+#2*2] Y0 I#2\nG3 X#1 Y0. R#2\nM2\n"
    model = random_model(machine, 3)
    written = correct(text, machine, model, travel_check=False).text
    seen = linuxcnc.run(written)
    assert seen.exit_status == 0
    np.testing.assert_allclose([move.end[:3] for move in seen.moves], read(written, machine).target, atol=1e-6)
    verdict = verify(read(text, machine), read(written, machine), model)
    assert verdict.before.largest > 10.0
    assert verdict.after.largest < 0.2


def test_a_block_at_several_places_that_want_different_corrections():
    machine = load("gantry")
    text = HEAD + "#1=0\nWHILE[#1 LT 3]DO1\nG1 X[#1*100] F100\n#1=#1+1\nEND1\n"
    with pytest.raises(
        UserError,
        match=r"test.nc:4: .*this block runs more than once and needs a different correction each time \('G1 X\[",
    ):
        correct(text, machine, random_model(machine, 3), travel_check=False)


def test_one_place_twice_is_one_place():
    machine = load("gantry")
    text = HEAD + "G0 X10. Y10. Z0.\nM98 P5\nG0 X10. Y10. Z0.\nM98 P5\nM30\nO5\nG1 X10. Y30. F100\nX50. Z-5.\nM99\n"
    written = correct(text, machine, random_model(machine, 3), travel_check=False).text
    assert written != text
    assert written.count("M98 P5") == 2


names = st.sampled_from(["#1", "#2", "#150", "#<a>"])
sums = st.recursive(
    names | st.integers(0, 9).map(str),
    lambda inner: st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"[{t[0]}{t[1]}{t[2]}]"),
    max_leaves=5,
)


@drawn(
    few=20,
    many=100,
    parts=st.lists(st.one_of(st.tuples(names, sums), st.tuples(st.sampled_from("XYZ"), sums)), min_size=3, max_size=12),
)
def test_generated_formulas_keep_their_values(parts):
    head = HEAD + "#1=1\n#2=2\n#150=3\n#<a>=4\n"
    text = head + "".join(f"{name}={value}\n" if name[0] == "#" else f"{name}{value}\n" for name, value in parts)
    machine = load("gantry")
    model = shifted(machine, **OFFSET)
    written = correct(text, machine, model, travel_check=False).text
    before, after = read(text, machine).target, read(written, machine).target
    np.testing.assert_allclose(after - before, np.broadcast_to(SHIFT, before.shape), atol=1e-9)


PLACED = {
    "G52": "G52 X10. Y-5.\nG0 X1. Y1. Z1.\nG1 X3. F100\nG2 X5. I1.\nG52 X0. Y0.\nG0 X7. Y7.\n",
    "one axis, again": "G52 Z3.\nG0 X1. Y1. Z1.\nG52 X4.\nG0 X1. Y1. Z1.\n",
    "increments": "G52 X10.\nG91 G0 X1. Y1.\nG90 X5. Y5.\n",
}


@pytest.mark.parametrize("name", PLACED)
def test_local_coordinates_are_those_of_linuxcnc(linuxcnc, name):
    machine, text = load("gantry"), HEAD + PLACED[name] + "M2\n"
    written = correct(text, machine, random_model(machine, 5), travel_check=False).text
    for program in (text, written):
        seen = linuxcnc.run(program)
        assert seen.exit_status == 0, seen
        np.testing.assert_allclose(
            [m.machine[:3] for m in seen.moves], read(program, machine).machine_target, atol=1e-6
        )


@pytest.mark.parametrize("angle", [90, 30, -45.5])
def test_turned_coordinates(angle):
    machine = load("gantry")
    text = (
        HEAD
        + f"G68 X10. Y20. R{angle}.\n".replace(".5.", ".5")
        + "G0 X15. Y20. Z5.\nG1 X30. F100\nG2 X40. I5.\nG91 G1 Y5.\nG90\nG69\nG0 X1. Y1.\n"
    )
    motions = read(text, machine)
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    assert motions.machine_target[1].tolist() == pytest.approx([10 + 5 * c, 20 + 5 * s, 5], abs=1e-9)
    assert motions.machine_target[4].tolist() == pytest.approx([10 + 30 * c - 5 * s, 20 + 30 * s + 5 * c, 5], abs=1e-9)
    assert motions.machine_target[5].tolist() == [1, 1, 5]
    model = random_model(machine, 5)
    written = correct(text, machine, model, travel_check=False).text
    assert text.splitlines()[1] in written
    verdict = verify(motions, read(written, machine), model)
    assert verdict.before.largest > 20.0
    assert verdict.after.largest < 0.2


@pytest.mark.parametrize("limit", [2, 9])
def test_a_do_loop_behind_a_while_loop_with_a_break(limit):
    """LinuxCNC 2.9 leaves it after its first pass, whether the break was reached or not."""
    loop = f"#1=0\no1 while [#1 lt 3]\n#1=[#1+1]\no2 if [#1 eq {limit}]\no1 break\no2 endif\nX#1\no1 endwhile\n"
    with pytest.raises(UserError, match="after a while loop with a break"):
        read(HEAD + loop + "o4 do\nX#1\n#1=[#1+1]\no4 while [#1 lt 9]\n", load("gantry"))


def test_a_repeat_loop_behind_the_continue_of_a_do_loop(linuxcnc):
    """LinuxCNC 2.9 runs it more than twice."""
    loop = "#1=0\no1 do\nX#1\n#1=[#1+1]\no2 if [#1 ge 2]\no1 continue\no2 endif\no1 while [#1 lt 3]\n"
    text = HEAD + loop + "o3 repeat [2]\nY9.\no3 endrepeat\n"
    with pytest.raises(UserError, match="runs a repeat loop too often after the continue of a do loop"):
        read(text, load("gantry"))
    assert [move.end[1] for move in linuxcnc.run(text + "M2\n").moves].count(9.0) > 2


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        ("G91\nG52 X1.", "G52 needs G90"),
        ("G52 X1. M8", "G52 cannot share a block with the other words"),
        ("G68 X1. R5.", "the centre needs X and Y, or it depends on the position of the tool"),
        ("G68 X1. Y1. R5.\nG54", "the effect of a new work offset on an active G52, G92, rotation, mirror or scale"),
        ("G68 X1. Y1. R5.\nG52 X1.", "G52 while the coordinates are rotated, mirrored or scaled"),
        ("G68 R5.", "needs X and Y"),
        ("G28 X0\nG92 X1.", "needs a programmed position"),
    ],
)
def test_places_that_controls_read_differently(block, reason):
    with pytest.raises(UserError) as caught:
        read(HEAD + block + "\n", load("gantry"))
    assert reason in str(caught.value)
