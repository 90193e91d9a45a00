"""Folders, job files and watched folders with programs that call one another: a set is corrected as one program."""

import json
import threading
import time
from pathlib import Path

import pytest
from support.called_programs import FANUC, KLARTEXT, MODEL, SIEMENS, written
from support.programs import load, model_of

import ncomp as public
from kinematics.effects import LocationError
from kinematics.error_model.model import write_model

GANTRY = ("--machine", "gantry", "--calibration", "cal.json", "--set-up-zero", "--no-travel-check", "--accept")
ACCEPTED = (*GANTRY, "outside,insignificant")
SET = {
    **{f"iso/{name}": text for name, text in FANUC.items()},
    **{f"siemens/{name}": text for name, text in SIEMENS.items()},
    **{f"klartext/{name}": text for name, text in KLARTEXT.items()},
}
MAINS = ["iso/O0001.nc", "klartext/main.h", "siemens/MAIN.MPF"]
NOT_CALLED = "siemens/TRANS.SPF"
"""Its name is a word of the language."""
OTHER = "%\nO0002\nG21 G90 G54 G17\nG0 X5. Y5. Z50.\nM98 P1000\nM30\n%\n"


@pytest.fixture(name="ncomp")
def _ncomp(command, tmp_path):
    """The command line in a folder with a calibration, and a folder of programs in three dialects, `in`."""
    write_model(MODEL, tmp_path / "cal.json")
    written(tmp_path / "in", SET)
    return command


def outputs(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_a_folder_is_corrected_set_by_set(ncomp, tmp_path):
    done = ncomp("batch", "in", "out", *ACCEPTED, "--json", "all.json", "-j", "1")
    assert done.status == 0, done.err
    programs = json.loads((tmp_path / "all.json").read_text())["programs"]
    assert [each["name"] for each in programs] == sorted([*MAINS, NOT_CALLED])
    assert outputs(tmp_path / "out") == sorted(SET)
    assert programs[0]["result"]["program"]["called"] == ["O1000.nc", "3", "o9001.NC"]
    for main in MAINS:
        verified = ncomp("verify", f"in/{main}", f"out/{main}", *GANTRY[:5], "--json", "-")
        assert json.loads(verified.out)["anywhere_um"]["after"] < 0.3, main
    again = ncomp("batch", "in", "out", *ACCEPTED, "-j", "1")
    assert again.status == 0, again.stderr


@pytest.mark.parametrize("head", ["", ";$PATH=/_N_WKS_DIR/_N_PART_WPD\n"])
def test_a_program_that_is_called_by_its_path_is_no_program_of_its_own(ncomp, tmp_path, head):
    main = f'{head}G71 G90 G54 G17\nG0 X100 Y100 Z50\nCALL "/_N_WKS_DIR/_N_PART_WPD/_N_L100_SPF"\nM30\n'
    files = {"MAIN.MPF": main, "L100.SPF": "G1 X300 Y200 Z0 F500\nM17\n"}
    folder = written(tmp_path / ("in/part" if head else "in/PART.WPD"), files)
    done = ncomp("batch", str(folder), "out", *ACCEPTED, "--json", "all.json", "-j", "1")
    assert done.status == 0, done.err
    assert [each["name"] for each in json.loads((tmp_path / "all.json").read_text())["programs"]] == ["MAIN.MPF"]
    assert outputs(tmp_path / "out") == ["L100.SPF", "MAIN.MPF"]


def test_a_program_that_two_others_call_is_written_out_in_both_where_it_is_corrected(ncomp, tmp_path):
    written(tmp_path / "in/iso", {"O0002.nc": OTHER})
    done = ncomp("batch", "in/iso", "out", *ACCEPTED, "--json", "all.json", "-j", "1")
    assert done.status == 0, done.err
    assert outputs(tmp_path / "out") == ["O0001.nc", "O0002.nc"]
    assert "X" in (tmp_path / "out/O0002.nc").read_text()
    notes = [each["result"]["notes"][0] for each in json.loads((tmp_path / "all.json").read_text())["programs"]]
    assert all("written out in the program, because other programs call" in note for note in notes)


def test_a_program_that_two_others_call_stays_a_file_where_nothing_is_corrected(ncomp, tmp_path):
    main = "%\nO0001\nG21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P5\nM30\n%\n"
    written(tmp_path / "two", {"O0001.nc": main, "O0002.nc": main.replace("O0001", "O0002"), "5": "O5\nM8\nM99\n"})
    assert ncomp("batch", "two", "out", *ACCEPTED, "-j", "1").status == 0
    assert outputs(tmp_path / "out") == ["5", "O0001.nc", "O0002.nc"]


def test_one_program_writes_its_set_beside_its_output(ncomp, tmp_path):
    done = ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "made.nc")
    assert done.status == 0, done.err
    assert outputs(tmp_path)[:3] == ["3", "O1000.nc", "cal.json"]
    assert "called programs, corrected in files beside the program: O1000.nc, 3, o9001.NC" in " ".join(done.err.split())


def test_an_edit_of_a_called_file_is_seen_from_the_main_program(ncomp, tmp_path):
    (tmp_path / "out").mkdir()
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "out/O0001.nc").status == 0
    shown = ncomp("verify", "out/O0001.nc")
    assert (shown.status, "Nor were the files that it calls" in shown.out.decode()) == (0, True), shown.out.decode()
    called = tmp_path / "out/O1000.nc"
    called.write_text(called.read_text().replace("F", "F1"))
    shown = ncomp("verify", "out/O0001.nc", "--json", "made.json").out.decode()
    assert "out/O1000.nc, which it calls, was EDITED since" in " ".join(shown.split())
    result = json.loads((tmp_path / "made.json").read_text())
    assert {each["name"]: each["edited"] for each in result["called"]}["out/O1000.nc"] is True
    assert result["edited"] is False


def test_standard_output_gets_one_program(ncomp, tmp_path):
    done = ncomp("in/iso/O0001.nc", *ACCEPTED)
    assert b"(O1000.NC LINE 3, PASS 1)" in done.out
    assert b"M98" not in done.out
    assert outputs(tmp_path)[0] == "cal.json"


def test_nothing_is_replaced_but_an_earlier_correction(ncomp, tmp_path):
    before = {path: path.read_bytes() for path in (tmp_path / "in").rglob("*") if path.is_file()}
    done = ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "in/iso/made.nc")
    assert (done.status, "--unroll" in done.err, "would replace in/iso/O1000.nc" in done.err) == (2, True, True)
    written(tmp_path, {"out/3": "(of another one)\n"})
    done = ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "out/made.nc")
    assert (done.status, "would replace out/3" in done.err) == (2, True)
    assert outputs(tmp_path / "out") == ["3"]
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "--unroll", "-o", "in/iso/made.nc").status == 0
    assert {path: path.read_bytes() for path in before} == before


MARK = "(NCOMP 0.1.0 MACHINE GANTRY CALIBRATION 0123456789AB)\n"
BAD_SETS = {
    "missing": ("iso/O0001.nc", "iso/O1000.nc", ("M98 P3", "M98 P4"), "in/iso/O1000.nc:5", "write it there, or give its folder"),
    "calls itself": ("iso/O0001.nc", "iso/O1000.nc", ("M98 P3", "M98 P1000"), "in/iso/O1000.nc:5", "end the recursion"),
    "twice": ("siemens/MAIN.MPF", "siemens/l100.SPF", None, "in/siemens/MAIN.MPF:6", "delete or rename one of them"),
    "path of another folder": ("siemens/MAIN.MPF", "siemens/MAIN.MPF", ('"_N_SIDE_SPF"', '"/_N_CUS_DIR/_N_SIDE_SPF"'), "in/siemens/MAIN.MPF:8", 'write CALL "NAME"'),
    "above the folder": ("klartext/main.h", "klartext/main.h", ("PGM part", "PGM ..\\iso\\part.h"), "in/klartext/main.h:6", "write its name alone"),
    "absolute path": ("klartext/main.h", "klartext/main.h", ("PGM part", "PGM TNC:\\part.h"), "in/klartext/main.h:6", "write its name alone"),
    "corrected already": ("iso/O0001.nc", "iso/3", ("O3\n", f"O3\n{MARK}"), "in/iso/3:2", "--force corrects it again"),
}  # fmt: skip


@pytest.mark.parametrize("way", ["files", "unroll", "batch"])
@pytest.mark.parametrize("name", BAD_SETS)
def test_nothing_of_a_set_that_cannot_be_used_is_written(ncomp, tmp_path, name, way):
    main, file, change, place, cure = BAD_SETS[name]
    text = SET[file].replace(*change) if change else "M17\n"
    assert text != SET.get(file)
    written(tmp_path / "in", {file: text})
    (tmp_path / "out").mkdir()
    run = {
        "files": (f"in/{main}", *ACCEPTED, "-o", "out/made"),
        "unroll": (f"in/{main}", *ACCEPTED, "--unroll", "-o", "out/made"),
        "batch": ("batch", str(Path("in", main).parent), "out", *ACCEPTED, "-j", "1"),
    }
    done = ncomp(*run[way])
    said = " ".join((done.out.decode() + done.err).split())
    assert (done.status, f"{place}:" in said, cure in said) == (2, True, True), said
    programs_of_their_own = {"PART.H"} if "write its name alone" in cure else set()
    assert set(outputs(tmp_path / "out")) <= {Path(NOT_CALLED).name, *programs_of_their_own}


def test_a_job_file_takes_the_sets_of_a_pattern(ncomp, tmp_path):
    head = 'machine = "gantry"\ncalibration = "cal.json"\nset_up_zero = true\nsubprograms = ["in/iso"]\n[correction]\n'
    text = 'travel_check = false\naccept = ["outside", "insignificant"]\n[programs]\n"*/*/*.MPF" = "corrected"\n'
    written(tmp_path, {"in/other/LONE.nc": OTHER})
    (tmp_path / "job.toml").write_text(head + text + '"in/other/LONE.nc" = "corrected/other.nc"\n')
    done = ncomp("job.toml", "-j", "1")
    assert done.status == 0, done.err
    names = sorted(f"in/{name}" for name in SET if name.startswith("siemens/") and name != NOT_CALLED)
    siemens = [f"in/siemens/{Path(name).name}" for name in names]
    assert set(outputs(tmp_path / "corrected")) == {*siemens, "other.nc", "O1000.nc", "3"}


def test_an_entry_of_a_called_program_has_the_output_of_its_set(ncomp, tmp_path):
    head = 'machine = "gantry"\ncalibration = "cal.json"\nset_up_zero = true\n[correction]\ntravel_check = false\naccept = ["outside", "insignificant"]\n'
    main = '[programs]\n"in/iso/O0001.nc" = "made/O0001.nc"\n"in/iso/O1000.nc" = '
    (tmp_path / "job.toml").write_text(head + main + '"elsewhere/O1000.nc"\n')
    done = ncomp("job.toml", "-j", "1")
    assert done.status == 2
    assert 'job file job.toml: programs."in/iso/O1000.nc": in/iso/O0001.nc calls this program' in " ".join(
        done.err.split()
    )
    assert not (tmp_path / "made").exists()
    assert not (tmp_path / "elsewhere").exists()
    (tmp_path / "job.toml").write_text(head + main + '"made/O1000.nc"\n')
    assert ncomp("job.toml", "-j", "1").status == 0
    assert "O1000.nc" in outputs(tmp_path / "made")


def test_verify_refuses_a_set_whose_files_are_of_two_corrections(ncomp, tmp_path):
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "out/O0001.nc").status == 2
    (tmp_path / "out").mkdir()
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "out/O0001.nc").status == 0
    write_model(model_of(load("gantry"), LocationError("X", "X", 40.0)), tmp_path / "cal.json")
    (tmp_path / "later").mkdir()
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "later/O0001.nc").status == 0
    (tmp_path / "out/O1000.nc").rename(tmp_path / "later/O1000.nc")
    done = ncomp("verify", "in/iso/O0001.nc", "later/O0001.nc", *GANTRY[:5])
    assert (done.status, "later/O1000.nc was corrected with another calibration" in done.err) == (2, True)


def test_check_follows_the_calls(ncomp, tmp_path):
    done = ncomp("check", "in/iso/O0001.nc", *GANTRY[:2], "--set-up-zero", "--no-travel-check", "--json", "-")
    found = json.loads(done.out)
    assert found["refused"] == []
    assert "O1000.nc:3-4" in found["corrected_lines"]
    (tmp_path / "in/iso/3").write_text("O3\nG31 X5.\nM99\n")
    done = ncomp("check", "in/iso/O0001.nc", *GANTRY[:2], "--set-up-zero", "--no-travel-check", "--json", "-")
    (refused,) = json.loads(done.out)["refused"]
    assert (refused["line"], refused["file"]) == (2, "in/iso/3")


def test_a_changed_subprogram_of_a_watched_folder_corrects_its_set_again(tmp_path):
    folder = written(tmp_path / "in", FANUC)
    write_model(MODEL, tmp_path / "cal.json")
    said: list[str] = []
    options = {"set_up": {"zero": True}, "travel_check": False, "accept": "outside,insignificant", "settle": 0.2}
    given = (folder, tmp_path / "out", "gantry", tmp_path / "cal.json")
    watching = threading.Thread(target=lambda: public.watch(*given, **options, idle=1.5, say=said.append))
    watching.start()
    _wait(lambda: len([line for line in said if line.startswith("corrected")]) == 1)
    assert outputs(tmp_path / "out") == sorted(FANUC)
    (folder / "3").write_text(FANUC["3"].replace("X700.", "X710."))
    _wait(lambda: len([line for line in said if line.startswith("corrected")]) == 2)
    (folder / "3").write_text("O3\nG31 X5.\nM99\n")
    _wait(lambda: any("O3" in line or "G31" in line for line in said if line.startswith("refused")))
    earlier = ["3.earlier", "O0001.nc.earlier", "O1000.nc.earlier", "o9001.NC.earlier"]
    assert outputs(tmp_path / "out") == earlier
    (folder / "3").unlink()
    (folder / "O0001.nc").write_text(FANUC["O0001.nc"] + "\n")
    _wait(lambda: any("no subprogram O3" in line for line in said))
    watching.join()
    assert not any("O1000.nc," in line for line in said)


def _wait(reached, seconds=20.0):
    until = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_a_program_that_is_called_by_a_calculated_number_never_gets_the_output_of_another(ncomp, tmp_path):
    main = "G21 G90 G54 G17\nG0 X100 Y100 Z50\n#1=100\no[#1] call\nM2\n"
    called = "o100 sub\nG1 X500 Y250 Z-5 F300\no100 endsub\nM2\n"
    written(tmp_path / "ngc", {"main.ngc": main, "100.ngc": called})
    done = ncomp("batch", "ngc", "out", *ACCEPTED, "-j", "1", "--json", "all.json")
    ends = {each["name"]: each for each in json.loads((tmp_path / "all.json").read_text())["programs"]}
    assert done.status == 2
    assert sorted(each["state"] == "refused" for each in ends.values()) == [False, True]
    assert ncomp("ngc/main.ngc", *ACCEPTED, "-o", "set.ngc").status == 0
    done = ncomp("ngc/100.ngc", *ACCEPTED, "-o", "100.ngc")
    assert (done.status, "the correction of a program that another one calls (CALLED BY MAIN.NGC)" in done.err) == (
        2,
        True,
    )


def test_a_called_file_without_corrections_never_replaces_that_of_another_main_program(ncomp, tmp_path):
    """Both parts have an O2000 of their own that moves nothing: the one of the second would end the first's G90."""
    main = "G21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P2000\nG0 X20. Y20. Z20.\nM30\n"
    for part, mode in (("a", "G90"), ("b", "G91")):
        written(tmp_path / part, {f"{part}.nc": main, "O2000": f"O2000\n{mode}\nM99\n"})
    (tmp_path / "made").mkdir()
    assert ncomp("a/a.nc", *ACCEPTED, "-o", "made/a.nc").status == 0
    written(tmp_path / "a", {"O2000": "O2000\nG94\nM99\n"})
    assert ncomp("a/a.nc", *ACCEPTED, "-o", "made/a.nc").status == 0
    first = (tmp_path / "made/O2000").read_bytes()
    assert b"G94" in first
    done = ncomp("b/b.nc", *ACCEPTED, "-o", "made/b.nc")
    assert (done.status, "would replace made/O2000" in done.err) == (2, True)
    assert outputs(tmp_path / "made") == ["O2000", "a.nc"]
    assert (tmp_path / "made/O2000").read_bytes() == first


def test_main_programs_of_one_name_never_share_a_called_file(ncomp, tmp_path):
    main = "O1\nG21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P1000\nM30\n"
    for part, x in (("a", 300), ("b", 400)):
        written(tmp_path / part, {"O0001.nc": main, "O1000.nc": f"O1000\nG1 X{x}. Y5. Z5. F500\nM99\n"})
    (tmp_path / "made").mkdir()
    for _ in range(2):
        assert ncomp("a/O0001.nc", *ACCEPTED, "-o", "made/a.nc").status == 0
    first = (tmp_path / "made/O1000.nc").read_bytes()
    done = ncomp("b/O0001.nc", *ACCEPTED, "-o", "made/b.nc")
    assert (done.status, "would replace made/O1000.nc" in done.err) == (2, True)
    assert (outputs(tmp_path / "made"), (tmp_path / "made/O1000.nc").read_bytes()) == (["O1000.nc", "a.nc"], first)


def test_verify_reads_the_corrections_of_subprograms_in_a_folder_inside_of_the_program_s(ncomp, tmp_path):
    main = "O1\nG21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P1000\nM30\n"
    called = "O1000\nG1 X300. Y200. Z10. F500\nM99\n"
    written(tmp_path / "own", {"O1.nc": main, "lib/O1000.nc": called})
    (tmp_path / "made").mkdir()
    assert ncomp("own/O1.nc", *ACCEPTED, "-o", "made/O1.nc", "--subprograms", "own/lib").status == 0
    assert outputs(tmp_path / "made") == ["O1.nc", "lib/O1000.nc"]
    options = (*GANTRY[:5], "--subprograms", "own/lib", "--json", "verdict.json")
    done = ncomp("verify", "own/O1.nc", "made/O1.nc", *options)
    assert (done.status, "has no mark" in done.err) == (0, False)
    assert json.loads((tmp_path / "verdict.json").read_text())["block_ends_um"]["after"]["max"] < 0.3


def test_a_link_to_itself_hides_no_other_file(ncomp, tmp_path):
    (tmp_path / "in/iso/loop").symlink_to("loop")
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "made.nc").status == 0
    assert ncomp("in/iso/O0001.nc", *ACCEPTED, "-o", "made.nc", "--subprograms", "").status == 2
