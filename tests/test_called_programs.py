"""Programs that call others: corrected as files, and judged by LinuxCNC, or by positions that are worked out by hand."""

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.called_programs import FANUC, GANTRY, KLARTEXT, MODEL, SIEMENS, written

import ncomp
from kinematics.user_error import UserError

SETUP = ncomp.set_up("gantry", zero=True, datum=["G54=true"])
PRESET = ncomp.set_up("gantry", zero=True, datum=["0=true"])


def tool_points(axes):
    """Where the gantry of MODEL has its tool, mm, at axis positions `(n, 3)`: its errors, um, are slopes in mm."""
    x, y, z = np.asarray(axes, float).T
    return np.column_stack([x + 0.020 + 1e-4 * x, y - 0.030 + 5e-5 * x, z - 5e-5 * y])


def corrected(program, into, **options):
    """A program corrected with its called files, which are written into a folder."""
    options = {"setup": SETUP, "travel_check": False, "accept": "outside,insignificant", "beside": True, **options}
    done = ncomp.correct(program, GANTRY, MODEL, **options)
    files = {Path(program).name: done.text, **{each.name: each.data.decode() for each in done.called}}
    written(into, files)
    return done


MOVE = re.compile(r"STRAIGHT_(?:FEED|TRAVERSE)\(([^,]*),([^,]*),([^,]*),")


def linuxcnc(program):
    """The ends of the moves of a program, mm, by LinuxCNC's interpreter, which finds called files in its folder."""
    command = ["rs274", "-g", program.name]
    done = subprocess.run(command, cwd=program.parent, capture_output=True, text=True, timeout=30, check=True)
    return np.array([[float(value) for value in match] for match in MOVE.findall(done.stdout)])


LINUXCNC = {
    "main.ngc": """\
G21 G90 G54 G17
G0 X100 Y100 Z50
o<pocket> call [200] [300]
o<pocket> call [1200] [700]
o100 call
G0 Z50
M2
""",
    "pocket.ngc": """\
o<pocket> sub
G0 X300 Y200 Z40
o100 call
o<pocket> endsub
M2
""",
    "100.ngc": """\
o100 sub
G1 X500 Y250 Z-5 F300
G1 X900 Y400
G1 Z10
o100 endsub
M2
""",
}


@pytest.mark.parametrize("line", ["G0 X300 Y200 Z40", "G0 X#1 Y#2 Z40"], ids=["alike", "different"])
def test_linuxcnc_cuts_the_programmed_path_with_the_corrected_files(tmp_path, line):
    files = {name: text.replace("G0 X300 Y200 Z40", line) for name, text in LINUXCNC.items()}
    folder = written(tmp_path / "in", files)
    done = corrected(folder / "main.ngc", tmp_path / "out")
    nominal, commanded = linuxcnc(folder / "main.ngc"), linuxcnc(tmp_path / "out" / "main.ngc")
    assert len(nominal) == 13
    assert np.abs(tool_points(nominal) - nominal).max() > 0.05
    assert np.abs(tool_points(commanded) - nominal).max() < 0.0003
    as_files = line == "G0 X300 Y200 Z40"
    assert sorted(each.name for each in done.called) == (["100.ngc", "pocket.ngc"] if as_files else [])
    assert ("o<pocket> call" in done.text) == as_files
    assert (folder / "main.ngc").read_text() == files["main.ngc"]


FANUC_PATH = np.array(
    [(100, 100, 50), *[(300, 200, 0), (700, 200, 0), (700, 300, 50)] * 2, (700, 300, 50), (450, 650, -1)], float
)


def test_a_set_of_fanuc_is_corrected_in_its_files(tmp_path):
    folder = written(tmp_path / "in", FANUC)
    done = corrected(folder / "O0001.nc", tmp_path / "out")
    assert sorted(each.name for each in done.called) == ["3", "O1000.nc", "o9001.NC"]
    out = {name: (tmp_path / "out" / name).read_text() for name in FANUC}
    assert "M98 P1000 L2" in out["O0001.nc"]
    assert "G65 P9001 A450. B650." in out["O0001.nc"]
    x, y, z = re.search(r"G1 X\[#1([-+][\d.]+)\] Y\[#2([-+][\d.]+)\] Z(\S+)", out["o9001.NC"]).groups()
    for words, point in (
        (re.search(r"X(\S+) Y(\S+) Z(\S+) F500", out["O1000.nc"]).groups(), (300, 200, 0)),
        (re.search(r"X(\S+) Y(\S+) Z(\S+)\nM99", out["3"]).groups(), (700, 300, 50)),
        ((450 + float(x), 650 + float(y), z), (450, 650, -1)),
    ):
        assert np.abs(tool_points([list(map(float, words))]) - point).max() < 0.0003
    verdict = ncomp.verify(folder / "O0001.nc", tmp_path / "out" / "O0001.nc", GANTRY, MODEL, setup=SETUP)
    assert verdict.verdict.before.largest > 50.0
    assert verdict.verdict.after.largest < 0.3


def changed(name, old, new):
    return {**FANUC, name: FANUC[name].replace(old, new)}


FANUC_GANTRY = replace(GANTRY, control=replace(GANTRY.control, family="fanuc"))
FANUC_SETUP = ncomp.set_up(FANUC_GANTRY, zero=True)


def test_the_programs_of_a_set_make_the_moves_of_its_calls(tmp_path):
    folder = written(tmp_path / "in", FANUC)
    done = ncomp.correct(folder / "O0001.nc", GANTRY, "none", setup=SETUP, travel_check=False)
    assert done.report.notes[0].startswith("the calls of O1000.nc, 3, o9001.NC are written out")
    assert np.allclose(done.moves.machine_target, FANUC_PATH)


@pytest.mark.parametrize("call", ["M98 P0002 1000", "M98 P2 1000", "M98P00021000"])
def test_repetitions_before_the_number_of_a_program(tmp_path, call):
    folder = written(tmp_path, changed("O0001.nc", "M98 P1000 L2", call))
    done = ncomp.correct(folder / "O0001.nc", FANUC_GANTRY, "none", setup=FANUC_SETUP, travel_check=False)
    assert np.allclose(done.moves.machine_target, FANUC_PATH)


HAAS = """\
%
O1 (HAAS)
G21 G90 G54 G17
G0 X100. Y100. Z50.
M97 P100 L2
M97P200
M30
N100 G91 G1 X10. F500.
M97 P200
G90
M99
N200 G1 Z20.
M99
%
"""
HAAS_PATH = [(100, 100, 50), (110, 100, 50), (110, 100, 70), (120, 100, 70), (120, 100, 90), (120, 100, 20)]


def test_a_haas_runs_the_blocks_from_a_number_on(tmp_path):
    """N200 is an increment where N100 calls it, and a position where the program does."""
    folder = written(tmp_path / "in", {"O1.nc": HAAS})
    nominal = ncomp.correct(folder / "O1.nc", FANUC_GANTRY, "none", setup=FANUC_SETUP, travel_check=False)
    assert np.allclose(nominal.moves.machine_target, HAAS_PATH)
    options = {"setup": FANUC_SETUP, "travel_check": False, "accept": "outside,insignificant"}
    done = ncomp.correct(folder / "O1.nc", FANUC_GANTRY, MODEL, unroll=True, **options)
    assert "M97" not in done.text
    out = written(tmp_path / "out", {"O1.nc": done.text}) / "O1.nc"
    verdict = ncomp.verify(folder / "O1.nc", out, FANUC_GANTRY, MODEL, setup=FANUC_SETUP).verdict
    assert verdict.before.largest > 10.0
    assert verdict.after.largest < 0.3


HAAS_REFUSED = {
    "no block of the number": ("M97P200", "M97P300", FANUC_GANTRY, r"O1\.nc:6: .*no blocks with the label 300"),
    "two blocks of the number": ("G90\nM99", "N200 G90\nM99", FANUC_GANTRY, r"O1\.nc:9: .*2 blocks with the label 200"),
    "no number": ("M97P200", "M97", FANUC_GANTRY, r"O1\.nc:6: .*M97 needs P"),
    "calls itself": ("N200 G1 Z20.", "N200 G1 Z20.\nM97 P200", FANUC_GANTRY, r"O1\.nc:13: .*end the recursion"),
    "another control": ("", "", GANTRY, r"O1\.nc:5: .*on HAAS only: write family"),
}


@pytest.mark.parametrize("name", HAAS_REFUSED)
def test_blocks_from_a_number_on_that_are_refused(tmp_path, name):
    old, new, machine, message = HAAS_REFUSED[name]
    folder = written(tmp_path, {"O1.nc": HAAS.replace(old, new)})
    with pytest.raises(UserError, match=message):
        ncomp.correct(folder / "O1.nc", machine, "none", setup=ncomp.set_up(machine, zero=True), travel_check=False)


@pytest.mark.parametrize("line", ["G4 P0002 1000", "G1 P0002 1000 X5."])
def test_a_number_with_a_blank_outside_of_a_call_is_refused(tmp_path, line):
    folder = written(tmp_path, changed("O0001.nc", "M98 P1000 L2", line))
    with pytest.raises(UserError, match=r"O0001\.nc:5: "):
        ncomp.correct(folder / "O0001.nc", FANUC_GANTRY, "none", setup=FANUC_SETUP, travel_check=False)


# arguments of G65, and by FANUC's manual (argument specification II) where G1 X#4 Y#7 Z#9 ends
REPEATED = {"A1. I4. J5. K6. I7. J8. K9.": (4, 7, 9), "I2. J3. K4. I5. J6. K7. I8.": (2, 5, 7), "I1. I2. I3. F8.": None}


@pytest.mark.parametrize("arguments", REPEATED)
def test_repeated_arguments_of_a_macro(tmp_path, arguments):
    main = f"O1\nG21 G90 G54\nG0 X9. Y9. Z9.\nG65 P100 {arguments}\nM30\n"
    folder = written(tmp_path, {"O1": main, "O100": f"O100\nG1 X#4 Y#7 Z#{9 if REPEATED[arguments] else 10} F9\nM99\n"})
    done = ncomp.correct(folder / "O1", GANTRY, "none", setup=SETUP, travel_check=False)
    assert tuple(done.moves.machine_target[-1]) == (REPEATED[arguments] or (1, 2, 3))


ORDER = {
    "J1. I2.": r"O1:4: .*in the order I, J, K",
    "I1. I2. D3.": r"O1:4: .*two arguments of the call have one variable",
    "I1. " * 11: r"O1:4: .*more than ten",
    "A1.": r"O100:2: .*X#4: it is empty",
}


@pytest.mark.parametrize("arguments", ORDER)
def test_arguments_whose_variable_is_not_clear_are_refused(tmp_path, arguments):
    main = f"O1\nG21 G90 G54\nG0 X9. Y9. Z9.\nG65 P100 {arguments}\nM30\n"
    folder = written(tmp_path, {"O1": main, "O100": "O100\nG1 X#4 F9\nM99\n"})
    machine = replace(GANTRY, control=replace(GANTRY.control, family="fanuc"))
    with pytest.raises(UserError, match=ORDER[arguments]):
        ncomp.correct(folder / "O1", machine, "none", setup=ncomp.set_up(machine, zero=True), travel_check=False)


REFUSED = {
    "missing": (
        {name: text for name, text in FANUC.items() if name != "3"},
        r"in/O1000\.nc:5: 'M98 P3': .*no subprogram O3, and no file of it is in \S*/in: .*subprograms",
    ),
    "recursion": (changed("O1000.nc", "P3", "P1000"), r"O1000\.nc:5: .*calls itself"),
    "recursion of two files": (changed("3", "M99", "M98 P1000\nM99"), r"in/3:3: .*calls itself"),
    "main program": (changed("3", "M99", "M98 P1\nM99"), r"O0001\.nc:5: .*calls itself"),
    "without an end": (changed("3", "M99\n", ""), r"in/3:2: .*no end: write M99"),
    "another program inside": (changed("3", "O3", "O4"), r"in/3 has no subprogram O3"),
    "twice": ({**FANUC, "o1000.NC": FANUC["O1000.nc"]}, r"O0001\.nc:5: .*O1000\.nc and o1000\.NC .*both named O1000"),
    "marked": (
        changed("O1000.nc", "O1000\n", "O1000\n(NCOMP 0.1.0 MACHINE GANTRY CALIBRATION 0123456789AB)\n"),
        r"in/O1000\.nc:3: .*already corrected",
    ),
    "Siemens": (
        {**FANUC, "O1000.nc": "G1 X=R1\nM17\n"},
        r"O0001\.nc:5: .*O1000\.nc is Siemens because of line 1.*program of one dialect",
    ),
    "not understood": (changed("3", "G0", "G31"), r"in/3:2: .*G31"),
    "empty": ({**FANUC, "3": ""}, r"in/3 is empty"),
}


@pytest.mark.parametrize("alike", [True, False])
def test_refusals_and_notes_of_a_program_that_is_written_out_name_the_line_of_the_input(tmp_path, alike):
    """The text with its calls written out has lines of its own, which nobody has seen."""
    move = "G1 X300. Y200. Z0. F500" if alike else "G91 G1 X30. Z-10. F500\nG90"
    main = f"%\nO0001\nG21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P1000 L3\n{'' if alike else 'M77'}\nM30\n%\n"
    folder = written(tmp_path / "in", {"O0001.nc": main, "O1000.nc": f"O1000\n{move}\nX9000.\nM77\nM99\n"})
    with pytest.raises(UserError, match=r"in/O1000\.nc:\d: 'X9000\.'.*outside"):
        ncomp.correct(folder / "O0001.nc", GANTRY, MODEL, setup=SETUP, beside=not alike)
    (folder / "O1000.nc").write_text(f"O1000\n{move}\nM77\nM99\n")
    done = ncomp.correct(folder / "O0001.nc", GANTRY, MODEL, setup=SETUP, travel_check=False)
    assert "O1000.NC LINE" in done.text
    (note,) = [note for note in done.report.notes if "M77" in note]
    assert f"(line O1000.nc:{3 if alike else 4}, {3 if alike else 4} times)" in note


def test_a_set_up_beside_a_called_file_is_refused(tmp_path):
    folder = written(tmp_path, {**FANUC, "O1000.nc.toml": "[work_offsets]\nG54 = { X = 5, Y = 0, Z = 0 }\n"})
    with pytest.raises(UserError, match=r"O0001\.nc:5: .*O1000\.nc\.toml is the set-up of O1000\.nc alone"):
        corrected(folder / "O0001.nc", tmp_path / "out")


@pytest.mark.parametrize(("files", "message"), REFUSED.values(), ids=REFUSED)
def test_a_set_that_cannot_be_used_is_refused_with_its_place(tmp_path, files, message):
    folder = written(tmp_path / "in", files)
    with pytest.raises(UserError, match=message):
        corrected(folder / "O0001.nc", tmp_path / "out")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    folder = written(tmp_path / "in", {name: text for name, text in FANUC.items() if name != "3"})
    written(tmp_path, {"elsewhere.nc": FANUC["3"]})
    (folder / "3").symlink_to(tmp_path / "elsewhere.nc")
    with pytest.raises(UserError, match=r"O1000\.nc:5: .*is a link to .*outside of its folder"):
        corrected(folder / "O0001.nc", tmp_path / "out")


def test_subprograms_of_another_folder_are_found_when_it_is_named(tmp_path):
    folder = written(tmp_path / "in", {"O0001.nc": FANUC["O0001.nc"]})
    library = written(tmp_path / "library", {name: text for name, text in FANUC.items() if name != "O0001.nc"})
    setup = ncomp.set_up("gantry", zero=True, datum=["G54=true"], subprograms=[library])
    done = corrected(folder / "O0001.nc", tmp_path / "out", setup=setup)
    assert sorted(each.name for each in done.called) == ["3", "O1000.nc", "o9001.NC"]
    with pytest.raises(UserError, match="corrected beside the program: correct it without beside for its moves"):
        _ = done.moves


SIEMENS_PATH = [
    *[(100, 100, 50), *[(300, 200, 0), (700, 200, 0), (700, 300, 50)] * 2, (450, 650, -1), (700, 300, 50)],
    *[(300, 200, 0), (700, 200, 0), (700, 300, 50), (600, 200, 10)],
]


def test_a_set_of_siemens_is_corrected_in_its_files(tmp_path):
    folder = written(tmp_path / "in", SIEMENS)
    nominal = ncomp.correct(folder / "MAIN.MPF", GANTRY, "none", setup=SETUP, travel_check=False).moves
    assert np.allclose(nominal.machine_target, SIEMENS_PATH)
    done = corrected(folder / "MAIN.MPF", tmp_path / "out")
    assert sorted(each.name for each in done.called) == ["DOUBLE.SPF", "L100.SPF", "_N_SIDE_SPF", "pocket.spf"]
    out = {name: (tmp_path / "out" / name).read_text() for name in SIEMENS if name != "TRANS.SPF"}
    assert re.sub("; NCOMP .*CALLED\n", "", out["DOUBLE.SPF"]) == SIEMENS["DOUBLE.SPF"]
    for line in ("L100 P2", 'CALL "_N_SIDE_SPF"', 'EXTCALL "L100.SPF"'):
        assert line in out["MAIN.MPF"]
    x, y, z = re.search(r"X=AA([-+][\d.]+) Y=BB([-+][\d.]+) Z(\S+) F200", out["pocket.spf"]).groups()
    turned = re.search(r"X=RESULT([-+][\d.]+) Y(\S+) Z(\S+)", out["MAIN.MPF"]).groups()
    for words, point in (
        (re.search(r"X(\S+) Y(\S+) Z(\S+) F500", out["L100.SPF"]).groups(), (300, 200, 0)),
        (re.search(r"X(\S+) Y(\S+) Z(\S+)\nRET", out["_N_SIDE_SPF"]).groups(), (700, 300, 50)),
        ((450 + float(x), 650 + float(y), z), (450, 650, -1)),
        ((600 + float(turned[0]), *turned[1:]), (600, 200, 10)),
    ):
        assert np.abs(tool_points([list(map(float, words))]) - point).max() < 0.0003
    verdict = ncomp.verify(folder / "MAIN.MPF", tmp_path / "out" / "MAIN.MPF", GANTRY, MODEL, setup=SETUP).verdict
    assert (verdict.before.largest > 50.0, verdict.after.largest < 0.3) == (True, True)


def test_mcall_runs_a_subprogram_after_every_move(tmp_path):
    main = "G71 G90 G54 G17\nG0 X100 Y100 Z50\nMCALL L7(5)\nX200 Y200\nX300 Y100\nMCALL\nX0 Y0\nM30\n"
    drill = "PROC L7(REAL DEPTH)\nG1 Z=-DEPTH F200\nG0 Z50\nM17\n"
    folder = written(tmp_path / "in", {"MAIN.MPF": main, "L7.SPF": drill})
    done = ncomp.correct(folder / "MAIN.MPF", GANTRY, "none", setup=SETUP, travel_check=False)
    holes = [(x, y, z) for x, y in ((200, 200), (300, 100)) for z in (50, -5, 50)]
    assert np.allclose(done.moves.machine_target, [(100, 100, 50), *holes, (0, 0, 50)])


@pytest.mark.parametrize(
    "line", ["HOLES1(0,0,0,10,20,3)", "SUPA G0 X10", "G53 G0 X10", "G75 FP=1 X1=0", "MCALL CYCLE81(10,0,2,-5)"]
)
def test_a_move_that_is_no_path_is_refused_while_mcall_of_a_subprogram_is_active(tmp_path, line):
    """The control runs the subprogram at the holes too: its moves there would be those of another position."""
    main = f"G71 G90 G54 G17\nG0 X100 Y100 Z50\nMCALL L7(5)\n{line}\nMCALL\nX0 Y0\nM30\n"
    folder = written(tmp_path / "in", {"MAIN.MPF": main, "L7.SPF": "PROC L7(REAL DEPTH)\nG91 G0 Z=-DEPTH\nM17\n"})
    with pytest.raises(UserError, match=r"MAIN\.MPF:4: .*MCALL of a subprogram is active: write its positions"):
        corrected(folder / "MAIN.MPF", tmp_path / "out")


SIEMENS_REFUSED = {
    "missing": ("L100 P2", "L200", r"MAIN\.MPF:6: 'L200': .*no subprogram L200, and no file of it is in \S*/in"),
    "absolute": ('"_N_SIDE_SPF"', '"/_N_SPF_DIR/_N_SIDE_SPF"', r"MAIN\.MPF:8: .*in its own folder"),
    "above": ('"_N_SIDE_SPF"', '"../SIDE"', r"MAIN\.MPF:8: .*in its own folder"),
    "absolute by a formula": ('"_N_SIDE_SPF"', '"/_N_SPF_DIR/" << "SIDE"', r"MAIN\.MPF:8: .*in its own folder"),
    "unknown": ('CALL "_N_SIDE_SPF"', "CALL WHICH", r"MAIN\.MPF:8: .*WHICH is not set by the program"),
    "blocks": ('CALL "_N_SIDE_SPF"', "CALL BLOCK N1 TO N2", r"MAIN\.MPF:8: .*CALL"),
    "with other words": ("L100 P2", "G1 X5 L100", r"MAIN\.MPF:6: .*must be alone"),
    "twice with VAR": ("DOUBLE(R1+300, RESULT)", "DOUBLE(300, RESULT) P2", r"DOUBLE\.SPF:1: .*VAR"),
    "number for VAR": ("DOUBLE(R1+300, RESULT)", "DOUBLE(300, 5)", r"DOUBLE\.SPF:1: .*VAR"),
}


@pytest.mark.parametrize(("old", "new", "message"), SIEMENS_REFUSED.values(), ids=SIEMENS_REFUSED)
def test_a_siemens_set_that_cannot_be_used_is_refused_with_its_place(tmp_path, old, new, message):
    folder = written(tmp_path / "in", {**SIEMENS, "MAIN.MPF": SIEMENS["MAIN.MPF"].replace(old, new)})
    with pytest.raises(UserError, match=message):
        corrected(folder / "MAIN.MPF", tmp_path / "out")


CALCULATED = {
    "joined": 'R5=-100\nCALL "L" << ABS(R5)',
    "variable": 'DEF STRING[20] WHICH="L100_SPF"\nCALL WHICH',
    "of its folder": 'CALL "/_N_WKS_DIR/_N_PART_WPD/L100"',
    "of its folder, joined": 'CALL "/_N_WKS_DIR/_N_PART_WPD/_N_L" << 100 << "_SPF"',
}


@pytest.mark.parametrize("line", CALCULATED.values(), ids=CALCULATED)
def test_a_siemens_program_called_by_a_formula_or_by_the_path_of_its_folder(tmp_path, line):
    main = f"%_N_MAIN_MPF\n;$PATH=/_N_WKS_DIR/_N_PART_WPD\nG71 G90 G54 G17\nG0 X100 Y100 Z50\n{line}\nM30\n"
    folder = written(tmp_path / "in", {"MAIN.MPF": main, "L100.SPF": "G1 X300 Y200 Z0 F500\nM17\n"})
    done = corrected(folder / "MAIN.MPF", tmp_path / "out")
    assert [each.name for each in done.called] == ["L100.SPF"]
    assert line.splitlines()[-1] in (tmp_path / "out" / "MAIN.MPF").read_text()
    words = re.search(r"X(\S+) Y(\S+) Z(\S+) F500", (tmp_path / "out" / "L100.SPF").read_text()).groups()
    assert np.abs(tool_points([list(map(float, words))]) - (300, 200, 0)).max() < 0.0003
    nominal = ncomp.correct(folder / "MAIN.MPF", GANTRY, "none", setup=SETUP, travel_check=False).moves
    assert nominal.machine_target[-1].tolist() == [300, 200, 0]


def test_the_folder_of_a_workpiece_gives_the_path_of_its_programs(tmp_path):
    line = 'CALL "/_N_WKS_DIR/_N_PART_WPD/_N_L100_SPF"'
    files = {"MAIN.MPF": f"G71 G90 G54 G17\nG0 X100 Y100 Z50\n{line}\nM30\n", "L100.SPF": "G1 X300 Y200 Z0 F500\nM17\n"}
    folder = written(tmp_path / "Part.WPD", files)
    nominal = ncomp.correct(folder / "MAIN.MPF", GANTRY, "none", setup=SETUP, travel_check=False).moves
    assert nominal.machine_target[-1].tolist() == [300, 200, 0]
    assert [each.name for each in corrected(folder / "MAIN.MPF", tmp_path / "out").called] == ["L100.SPF"]
    with pytest.raises(UserError, match=r"MAIN\.MPF:3: .*by its name, or by a path in its own folder"):
        corrected(written(tmp_path / "OTHER.WPD", files) / "MAIN.MPF", tmp_path / "out")


KLARTEXT_PATH = [
    *[(100, 100, 50), (700, 200, 0), (300, 200, 0), (700, 200, 0), (700, 300, 50), (800, 800, 50), (450, 650, -1)],
    *[(200, 500, 60), (700, 300, 50), (700, 300, 50), (7, 0, 60)],
]


def test_a_set_of_klartext_is_corrected_in_its_files(tmp_path):
    folder = written(tmp_path / "in", KLARTEXT)
    nominal = ncomp.correct(folder / "main.h", GANTRY, "none", setup=PRESET, travel_check=False).moves
    assert np.allclose(nominal.machine_target, KLARTEXT_PATH)
    done = corrected(folder / "main.h", tmp_path / "out", setup=PRESET)
    assert sorted(each.name for each in done.called) == ["END.H", "PART.H", "macro.h", "sub/deep.h", "sub/inner.h"]
    out = {name: (tmp_path / "out" / name).read_text() for name in KLARTEXT}
    assert "CALL PGM sub\\inner.h" in out["main.h"]
    assert re.sub("; NCOMP .*CALLED\n", "", out["sub/inner.h"]) == KLARTEXT["sub/inner.h"]
    added = re.search(r"QL450 =\+?Q1 \+ ([-+][\d.]+)", out["macro.h"])
    y, z = re.search(r"X\+QL450 Y(\S+) Z(\S+) F200", out["macro.h"]).groups()
    for words, point in (
        (re.search(r"X(\S+) Y(\S+) Z(\S+) FMAX\n", out["END.H"]).groups(), (700, 300, 50)),
        (re.search(r"X(\S+) Y(\S+) Z(\S+) FMAX\n", out["sub/deep.h"]).groups(), (800, 800, 50)),
        (re.search(r"L X(\S+) Y(\S+) Z(\S+) F500", out["PART.H"]).groups(), (300, 200, 0)),
        ((450 + float(added[1]), y, z), (450, 650, -1)),
    ):
        assert np.abs(tool_points([list(map(float, words))]) - point).max() < 0.0003
    verdict = ncomp.verify(folder / "main.h", tmp_path / "out" / "main.h", GANTRY, MODEL, setup=PRESET).verdict
    assert (verdict.before.largest > 50.0, verdict.after.largest < 0.3) == (True, True)


def test_a_set_of_klartext_is_written_out(tmp_path):
    folder = written(tmp_path / "in", KLARTEXT)
    done = corrected(folder / "main.h", tmp_path / "out", setup=PRESET, beside=False)
    assert "written out in the program" in done.report.notes[0]
    assert (done.text.count("BEGIN PGM"), done.text.count("END PGM"), done.text.count("CALL")) == (1, 1, 1)
    written(tmp_path / "alone", {"main.h": done.text})
    verdict = ncomp.verify(folder / "main.h", tmp_path / "alone" / "main.h", GANTRY, MODEL, setup=PRESET).verdict
    assert (verdict.before.largest > 50.0, verdict.after.largest < 0.3) == (True, True)


KLARTEXT_REFUSED = {
    "missing": (
        "main.h",
        "CALL PGM part",
        "CALL PGM other",
        r"main\.h:6: .*its file is not in the folder.*subprograms",
    ),
    "absolute": ("main.h", "PGM part", "PGM TNC:\\part.h", r"main\.h:6: .*outside of the folder"),
    "above": ("main.h", "sub\\", "..\\sub\\", r"main\.h:7: .*outside of the folder"),
    "recursion": ("END.H", "L X+7", "CALL PGM PART\nL X+7", r"END\.H:2: .*calls itself"),
    "main": ("END.H", "L X+7", "CALL PGM MAIN\nL X+7", r"END\.H:2: .*main\.h is the main program"),
    "end of all": ("END.H", "END PGM", "M30\nEND PGM", r"END\.H:3: .*M2 or M30 in a called program"),
    "inch": ("END.H", "END MM", "END INCH", r"END\.H:1: .*called program is in INCH and the main program in MM"),
    "label of the caller": ("END.H", "END PGM", "CALL LBL 1\nEND PGM", r"END\.H:3: .*no subprogram LBL 1"),
    "nothing selected": ("main.h", '7 SEL PGM "macro.H"\n', "", r"main\.h:8: .*SEL PGM.*not set"),
    "QL of the caller": ("END.H", "X+700", "X+QL1", r"END\.H:2: .*QL1 is not set"),
    "ISO": ("END.H", KLARTEXT["END.H"], "G1 X#1\nM99\n", r"END\.H is ISO because of line 1"),
}


@pytest.mark.parametrize(("name", "old", "new", "message"), KLARTEXT_REFUSED.values(), ids=KLARTEXT_REFUSED)
def test_a_klartext_set_that_cannot_be_used_is_refused_with_its_place(tmp_path, name, old, new, message):
    assert old in KLARTEXT[name]
    folder = written(tmp_path / "in", {**KLARTEXT, name: KLARTEXT[name].replace(old, new, 1)})
    with pytest.raises(UserError, match=message):
        corrected(folder / "main.h", tmp_path / "out", setup=PRESET)


SAVING = {
    "MAIN.MPF": "G71 G90 G54 G17\nG0 X100 Y100 Z50\nL7 P2\nX20\nM30\n",
    "L7.SPF": "PROC L7 SAVE DISPLOF\nG1 X10 Y20 Z30 F500\nG91\nX5\nM17\n",
}


def test_modes_are_those_of_the_caller_again_behind_each_run_of_a_subprogram_with_save(tmp_path):
    folder = written(tmp_path / "in", SAVING)
    done = corrected(folder / "MAIN.MPF", tmp_path / "out")
    findings = ncomp.check(folder / "MAIN.MPF", GANTRY, setup=SETUP, travel_check=False)
    assert (findings.refused, done.report.moves) == ([], 6)
    verdict = ncomp.verify(folder / "MAIN.MPF", tmp_path / "out" / "MAIN.MPF", GANTRY, MODEL, setup=SETUP).verdict
    assert verdict.after.largest < 0.3
    x, y, z = re.search(r"G1 X(\S+) Y(\S+) Z(\S+) F500", (tmp_path / "out" / "L7.SPF").read_text()).groups()
    assert np.abs(tool_points([[float(x), float(y), float(z)]]) - (10, 20, 30)).max() < 0.0003
    with pytest.raises(UserError, match=r"L7\.SPF:1: .*SAVE cannot be written out"):
        corrected(folder / "MAIN.MPF", tmp_path / "one", beside=False)


def test_a_called_file_that_is_there_is_followed_where_calls_are_stated_to_leave_the_state(tmp_path):
    machine = replace(GANTRY, control=replace(GANTRY.control, calls_leave_state=True))
    main = "BEGIN PGM MAIN MM\nL X+100 Y+100 Z+50 R0 FMAX\nCALL PGM END\nCALL PGM TNC:\\change.h\nEND PGM MAIN MM\n"
    folder = written(tmp_path / "in", {"main.h": main, "END.H": KLARTEXT["END.H"]})
    options = {"setup": ncomp.set_up(machine, zero=True), "travel_check": False}
    done = ncomp.correct(folder / "main.h", machine, "none", beside=True, **options)
    assert ([each.name for each in done.called], done.report.moves) == (["END.H"], 2)
    assert any("CALL PGM TNC" in note for note in done.report.notes)


@pytest.mark.parametrize("main", ["o100 sub\nG1 X1 F9\no100 endsub\no<p> call\n", "o<p> call\no<q> call\n"])
def test_a_subprogram_in_two_files_is_refused(tmp_path, main):
    """LinuxCNC runs the one that it has met first, whatever the file of the call."""
    inner = "o<{0}> sub\no100 call\no<{0}> endsub\no100 sub\nG1 X2 Y2 Z2 F100\no100 endsub\nM2\n"
    files = {"main.ngc": f"G21 G90 G54\nG0 X9 Y9 Z9\n{main}M2\n", **{f"{n}.ngc": inner.format(n) for n in "pq"}}
    folder = written(tmp_path, files)
    assert len(linuxcnc(folder / "main.ngc")) == 1 + main.count("call")
    with pytest.raises(UserError, match=r"[pq]\.ngc:2: .*both have a subprogram O100"):
        corrected(folder / "main.ngc", tmp_path / "out")


BESIDE = {
    "o-word": ("o100 call\nM2\no100 sub\nG1 X2 F100\no100 endsub\n", "o100 sub\nG1 X7 F100\no100 endsub\nM2\n"),
    "M98": ("M98 P100\nM2\nO100\nG1 X2 F100\nM99\n", "O100\nG1 X7 F100\nM99\n"),
}


@pytest.mark.parametrize(("calling", "called"), BESIDE.values(), ids=BESIDE)
def test_a_subprogram_that_has_a_file_beside_its_own_place_is_refused(tmp_path, calling, called):
    """LinuxCNC reads 100.ngc, because it has not met the beginning in the file of the call yet."""
    folder = written(tmp_path, {"main.ngc": f"G21 G90 G54\nG0 X9 Y9 Z9\n{calling}", "100.ngc": called})
    assert linuxcnc(folder / "main.ngc")[-1, 0] == 7.0
    with pytest.raises(UserError, match=r"main\.ngc:3: .*100\.ngc is a file of O100 too"):
        corrected(folder / "main.ngc", tmp_path / "out")
