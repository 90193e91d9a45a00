"""The wrapper of LinuxCNC's interpreter, against values worked out by hand."""

import stat
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
from clients import rs274
from clients.rs274 import Tool
from support.tiers import quick

TEXT = 5e-5 + 1e-12  # rs274 prints four decimals
DOUBLE = 1e-12


def program(*blocks: str) -> str:
    return "\n".join([*blocks, "M2", ""])


def ends(moves):
    return [move.end for move in moves]


def close(actual, expected, tolerance=DOUBLE):
    """Compare rows of coordinates, the missing last ones of `expected` being zero."""
    assert len(actual) == len(expected)
    for row, wanted in zip(actual, expected, strict=True):
        padded = tuple(wanted) + (0.0,) * (len(row) - len(wanted))
        assert row == pytest.approx(padded, abs=tolerance, rel=0.0)
    return True


def both(text, **options):
    """The moves by either front end, after checking that they say the same."""
    printed = rs274.rs274_moves(text, **options)
    exact = rs274.gcode_moves(text, **options)
    assert [(m.kind, m.plane, m.turns) for m in printed] == [(m.kind, m.plane, m.turns) for m in exact]
    assert close([m.end for m in printed], [m.end for m in exact], TEXT)
    assert close([m.machine for m in printed], [m.machine for m in exact], 3 * TEXT)
    assert close([m.centre or () for m in printed], [m.centre or () for m in exact], TEXT)
    assert [m.feed for m in printed] == pytest.approx([m.feed for m in exact], abs=TEXT)
    return printed, exact


@pytest.mark.usefixtures("linuxcnc")
class TestMoves:
    def test_lines_carry_kind_feed_block_number_and_source_line(self):
        text = program("N10 G0 X1 Y2 Z3", "(no move)", "N20 G1 X10.1234567 A5 B-6 C370 F500", "N30 F250", "N40 Y-2.5")
        printed, exact = both(text)
        wanted = [(1, 2, 3), (10.1234567, 2, 3, 5, -6, 370), (10.1234567, -2.5, 3, 5, -6, 370)]
        assert close(ends(exact), wanted)
        assert close(ends(printed), wanted, TEXT)
        assert [m.kind for m in exact] == ["rapid", "line", "line"]
        assert [m.feed for m in exact][1:] == pytest.approx([500, 250])
        assert [m.number for m in printed] == [10, 20, 40]
        assert [m.line for m in exact] == [1, 3, 5]

    def test_no_move_is_lost_where_the_block_number_is_glued_to_the_command(self):
        blocks = [f"N{n} G0 X{n - 99_990}" for n in range(99_998, 100_003)]
        printed, _ = both(program(*blocks))
        assert [m.number for m in printed] == [99_998, 99_999, 100_000, 100_001, 100_002]
        assert [m.end[0] for m in printed] == [8, 9, 10, 11, 12]

    def test_incremental_moves_add_up(self):
        _, exact = both(program("G91", "G0 X1 Y1", "G1 X0.1 F100", "X0.1", "G90 X5", "G91 Z-2 C-90", "C-300"))
        wanted = [(1, 1), (1.1, 1), (1.2, 1), (5, 1), (5, 1, -2, 0, 0, -90), (5, 1, -2, 0, 0, -390)]
        assert close(ends(exact), wanted)

    def test_inch_programs_come_out_in_mm_with_their_angles_and_feed(self):
        text = program("G20", "G0 X1 Y0.1 B45", "G1 Z-0.00005 F10", "G21 X10", "G20 G2 X1 Y0.1 R2")
        exact = rs274.gcode_moves(text)
        wanted = [(25.4, 2.54, 0, 0, 45), (25.4, 2.54, -0.00127, 0, 45), (10, 2.54, -0.00127, 0, 45)]
        assert close(ends(exact)[:3], wanted)
        assert exact[1].feed == pytest.approx(254)
        printed = rs274.rs274_moves(text)
        assert close(ends(printed)[:3], wanted, 25.4 * TEXT)
        x, y, _ = exact[3].centre
        assert (x - 10) ** 2 + (y - 2.54) ** 2 == pytest.approx(50.8**2)
        assert exact[3].turns == -1

    def test_a_program_starts_at_machine_zero(self):
        _, exact = both(program("G0 X0"), work_offsets={"G54": (10, 20, 30, 5)})
        assert close(ends(exact), [(0, -20, -30, -5)])
        assert close([m.machine for m in exact], [(10, 0, 0, 0)])

    def test_canned_cycle_is_expanded(self):
        _, exact = both(program("G0 Z10", "G99 G81 X5 Y6 Z-3 R2 F100", "X15", "G80"))
        assert {m.end[:2] for m in exact if m.end[2] == pytest.approx(-3)} == {(5.0, 6.0), (15.0, 6.0)}
        assert exact[-1].end[2] == pytest.approx(2)

    def test_probe_and_tap(self):
        _, exact = both(program("S100 M3", "G0 X1 Z5", "G33.1 Z-9 K1", "G38.2 Z2 F10"))
        assert [m.kind for m in exact] == ["rapid", "tap", "probe"]
        assert close(ends(exact), [(1, 0, 5), (1, 0, -9), (1, 0, 2)])

    def test_variables_and_loops_are_resolved(self):
        text = program("#1 = 0", "o1 while [#1 lt 3]", "#1 = [#1 + 1]", "G0 X[#1 / 3]", "o1 endwhile")
        _, exact = both(text)
        assert close(ends(exact), [(1 / 3,), (2 / 3,), (1,)])


@pytest.mark.usefixtures("linuxcnc")
class TestArcs:
    # A quarter turn about the origin from (10, 0) to (0, 10) of the plane's own two axes; the third goes to 4.
    PLANES = pytest.mark.parametrize(
        ("select", "plane", "start", "end", "offset"),
        [
            ("G17", "xy", (10, 0, 0), (0, 10, 4), "I-10 J0"),
            ("G18", "xz", (0, 0, 10), (10, 4, 0), "K-10 I0"),
            ("G19", "yz", (0, 10, 0), (4, 0, 10), "J-10 K0"),
        ],
    )

    @PLANES
    @pytest.mark.parametrize(("code", "turns"), [("G3", 1), ("G2", -1)])
    def test_helix_in_each_plane(self, select, plane, start, end, offset, code, turns):
        go = "G0 X{} Y{} Z{}".format(*start)
        arc = "{} X{} Y{} Z{} {} C30 F100".format(code, *end, offset)
        _, exact = both(program(select, go, arc))
        assert close(ends(exact), [start, (*end, 0, 0, 30)])
        move = exact[1]
        level = tuple(4.0 if value == 4 else 0.0 for value in end)
        assert (move.kind, move.plane, move.turns) == ("arc", plane, turns)
        assert close([move.centre], [level])

    @PLANES
    def test_radius_form_gives_the_same_centre(self, select, plane, start, end, offset):
        go = "G0 X{} Y{} Z{}".format(*start)
        by_offset = "G3 X{} Y{} Z{} {} F100".format(*end, offset)
        by_radius = "G3 X{} Y{} Z{} R10 F100".format(*end)
        first, second = (rs274.gcode_moves(program(select, go, arc))[1] for arc in (by_offset, by_radius))
        assert first.plane == plane
        assert first.centre == pytest.approx(second.centre, abs=1e-9)

    def test_absolute_centres_and_full_turns(self):
        _, exact = both(program("G0 X10", "G90.1 G3 X10 Y0 I4 J0 F100", "G91.1 G2 X10 Y0 Z-3 I-5 J0 P3"))
        assert [m.turns for m in exact[1:]] == [1, -3]
        assert close([m.centre for m in exact[1:]], [(4, 0, 0), (5, 0, -3)])

    def test_incremental_arc(self):
        _, exact = both(program("G0 X7 Y3", "G91", "G2 X5 Y5 I5 F100"))
        assert close(ends(exact), [(7, 3), (12, 8)])
        assert close([exact[1].centre], [(12, 3, 0)])


@pytest.mark.usefixtures("linuxcnc")
class TestFrames:
    def test_work_offsets_and_moves_in_machine_coordinates(self):
        text = program("G55 G0 X1 Y1 Z1 B10", "G53 G0 X0 Y0 Z-5", "X2", "G54 X2")
        offsets = {"G55": (100, 200, -300.125, 0, 7, 0), "G54": (-1, 0, 0)}
        _, exact = both(text, work_offsets=offsets)
        machine = [(101, 201, -299.125, 0, 17), (0, 0, -5, 0, 17), (102, 0, -5, 0, 17), (1, 0, -5, 0, 17)]
        assert close([m.machine for m in exact], machine)
        assert close(ends(exact)[:2], [(1, 1, 1, 0, 10), (-100, -200, 295.125, 0, 10)])

    def test_rotation_and_g92(self):
        # G54 turned by 90 degrees at (5, 6): its x is the machine's y. Then machine zero is called (1, 1).
        _, exact = both(program("G10 L2 P1 X5 Y6 R90", "G0 X1 Y0", "G53 G0 X0 Y0", "G92 X1 Y1", "G0 X3 Y1"))
        assert close([m.machine for m in exact], [(5, 7), (0, 0), (0, 2)])

    def test_tool_length_and_radius(self):
        tools = {3: Tool(length=120.5), 12: Tool(length=80.0, diameter=10.0)}
        text = program("T3 M6", "G43 H3 G0 Z10", "T12 M6 G43", "Z10", "G49", "G1 G41 D12 X20 F100", "Y50", "G40 X0")
        _, exact = both(text, tools=tools)
        assert [m.machine[2] for m in exact[:2]] == pytest.approx([130.5, 90])
        assert exact[3].end[0] == pytest.approx(15)  # the cutter's centre, 5 mm to the left of X20 going up

    def test_every_tool_named_exists_without_length_when_no_table_is_given(self):
        _, exact = both(program("(T9)", "T1 M6", "g43 h77", "G0 Z10"))
        assert exact[-1].machine[2] == pytest.approx(10)


@pytest.mark.usefixtures("linuxcnc")
class TestRefusals:
    @pytest.mark.parametrize(
        ("text", "line", "message"),
        [
            ("G0 X1\nG68 X1\nM2\n", 2, "Unknown g code used"),
            ("G0 X1\nM128\nM2\n", 2, "Unknown m code used"),
            ("G0 X1\nG1 X2\nM2\n", 2, "Cannot do g1 with zero feed rate"),  # the gcode module lets it pass
            ("G0 X1 X2\nM2\n", 1, "Multiple x words"),
            ("G0 X0 Y0\nG2 X10.03 Y0 I5 J0 F100\nM2\n", 2, "Radius to end of arc differs"),
            ("G0 X1\n(\nM2\n", 2, "Unclosed comment"),
            ("T5 M6\nM2\n", 1, "Requested tool 5 not found"),
            ("G0 X1\n", 1, "File ended with no percent sign or program end"),
            ("G0 X" + "0" * 260 + "1\nM2\n", None, "Command too long"),
            ("", 0, "File ended with no percent sign"),
        ],
    )
    def test_refused_with_message_and_line(self, text, line, message):
        result = rs274.run(text, tools={})
        assert result.exit_status == 1
        assert message in result.message
        assert line is None or result.line == line
        with pytest.raises(rs274.RefusedError, match=message):
            rs274.rs274_moves(text, tools={})

    def test_moves_before_the_refusal_are_kept(self):
        result = rs274.run("G0 X1\nX2\nG68\nX3\nM2\n")
        assert [m.end[0] for m in result.moves] == pytest.approx([1, 2])
        assert (result.line, result.block) == (3, "G68")

    def test_accepted_program_has_no_message(self):
        result = rs274.run("%\nO0001 (PART)\nG0 X1 ; go\n/ G0 X2\n%\n")
        assert (result.exit_status, result.message, result.line) == (0, "", None)
        assert [m.end[0] for m in result.moves] == pytest.approx([1, 2])  # block delete is off

    def test_text_printed_by_the_program_is_not_taken_for_a_move(self):
        _, exact = both(program("(PRINT, hello)", "(MSG, hello)", "G0 X1"))
        assert len(exact) == 1

    def test_endless_program_is_stopped(self):
        with pytest.raises(subprocess.TimeoutExpired):
            rs274.run(program("o1 while [1]", "G4 P0", "o1 endwhile"), timeout=0.3)

    def test_missing_file(self, tmp_path):
        with pytest.raises(FileNotFoundError):
            rs274.run(tmp_path / "none.ngc")

    def test_read_only_file_is_read_and_left_as_it_is(self, tmp_path):
        path = tmp_path / "part with blanks.ngc"
        path.write_bytes(b"G0 X1 (\xb5m)\r\nM2\r\n")
        path.chmod(stat.S_IRUSR)
        assert len(rs274.run(path).moves) == 1
        assert path.read_bytes() == b"G0 X1 (\xb5m)\r\nM2\r\n"
        assert list(tmp_path.iterdir()) == [path]


# Programs that LinuxCNC takes as they are, with the number of moves it makes of them.
TAKEN = {
    "easy_gcode_plot/G17_18_19.NC": 15,
    "easy_gcode_plot/G17_18_19_G91.NC": 15,
    "easy_gcode_plot/PARALLEL.NC": 3722,
    "easy_gcode_plot/TEST3.NC": 25,
    "easy_gcode_plot/TEST_G90.NC": 140,
    "easy_gcode_plot/TEST_G91.NC": 140,
    "five_axis_ac/impeller-7bl-xyzac.ngc": 4492,
}


@pytest.mark.usefixtures("linuxcnc")
class TestRealPrograms:
    @pytest.mark.parametrize("name", quick(TAKEN, [name for name, moves in TAKEN.items() if moves < 1000]))
    def test_both_front_ends_agree(self, nc_data: Path, name):
        printed, exact = both(nc_data / "iso" / name)
        assert len(exact) == len(printed) == TAKEN[name]
        assert all(b.line >= a.line for a, b in pairwise(exact))

    def test_absolute_and_incremental_twins_make_the_same_moves(self, nc_data: Path):
        absolute, incremental = (
            rs274.run(nc_data / "iso" / "easy_gcode_plot" / name).moves for name in ("TEST_G90.NC", "TEST_G91.NC")
        )
        assert close(ends(absolute), ends(incremental), 0.005)  # each was rounded to 0.001 when it was posted
