"""An option of the set-up that has no effect is a mistake: refused, or the first line of the verdict."""

import json
from pathlib import Path

import pytest

import ncomp as library

MACHINE = (Path(__file__).parents[1] / "machines" / "gantry.toml").read_text()
ISO = "G21 G90 G54\nT1 M6\nG0 X100 Y100\nG0 G43 H1 Z100\nG1 X200 F500\nM30\n"
SIEMENS = "G71 G90 G54\nT1 M6\nG0 X100 Y100 Z100 D1\nG1 X200 F500\nM30\n"
KLARTEXT = (
    "0 BEGIN PGM A MM\n1 CYCL DEF 247 DATUM SETTING Q339=+1\n2 TOOL CALL 1 Z S3000\n3 L X+100 Y+100 Z+100 R0 FMAX\n"
    "4 L X+200 F500\n5 END PGM A MM\n"
)
PROGRAMS = {"part.nc": ISO, "part.mpf": SIEMENS, "part.h": KLARTEXT}


@pytest.fixture
def shop(ncomp):
    """A machine file with work offsets and the tool, and a program of each dialect."""
    text = MACHINE.split("[work_offsets]")[0]
    offset = "{ X = 1, Y = 2, Z = 3 }"
    Path("mill.toml").write_text(f"{text}[work_offsets]\nG54 = {offset}\n1 = {offset}\n\n[tools]\n1 = 100\n")
    for name, program in PROGRAMS.items():
        Path(name).write_text(program)
    return ncomp


MISTAKES = [
    ("part.nc", "--work-offset", "G45=1,2,3", "work offset G45 was given and is not used", "did you mean 'G54'?"),
    ("part.nc", "--work-offset", "54=1,2,3", "work offset 54", "did you mean 'G54'?"),
    ("part.nc", "--work-offset", "G54P1=1,2,3", "work offset G54P1", "did you mean 'G54'?"),
    ("part.nc", "--work-offset", "G55=1,2,3", "work offset G55", "did you mean 'G54'?"),
    ("part.nc", "--tool-length", "H1=50", "tool length H1", "did you mean 'T1'?"),
    ("part.nc", "--tool-length", "T11=50", "tool length T11", "did you mean 'T1'?"),
    ("part.nc", "--datum", "G55=true", "the datum of G55", "did you mean 'G54'?"),
    ("part.mpf", "--work-offset", "G45=1,2,3", "work offset G45", "did you mean 'G54'?"),
    ("part.mpf", "--work-offset", "$P_UIFR[1]=1,2,3", "work offset $P_UIFR[1]", "did you mean 'G54'?"),
    ("part.mpf", "--tool-length", "D1=50", "tool length D1", "did you mean 'T1'?"),
    ("part.h", "--work-offset", "G54=1,2,3", "work offset G54", "did you mean '1'?"),
    ("part.h", "--tool-length", "TOOL1=50", "tool length TOOL1", "did you mean 'T1'?"),
]


@pytest.mark.parametrize(("program", "option", "value", "said", "meant"), MISTAKES)
def test_a_set_up_without_effect_is_refused(shop, program, option, value, said, meant):
    done = shop(program, "--machine", "mill.toml", "-c", "cal.json", option, value, "-o", "out.nc", "--quiet")
    assert done.status == 2
    assert said in done.err
    assert meant in done.err
    assert not Path("out.nc").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("check", "part.nc"),
        ("verify", "part.nc", "part.nc", "-c", "none"),
        ("export", "--program", "part.nc", "-c", "cal.json", "--format", "csv", "-o", "tables"),
        ("simulate", "--path", "part.nc", "--target", "t=0,0,-100", "-o", "out.csv"),
        ("job.toml",),
    ],
)
def test_every_command_that_takes_a_set_up_refuses_it(shop, words):
    Path("job.toml").write_text(
        'machine = "mill.toml"\ncalibration = "cal.json"\n[work_offsets]\nG45 = { X = 1, Y = 2, Z = 3 }\n'
        '[programs]\n"part.nc" = "out.nc"\n'
    )
    options = () if words == ("job.toml",) else ("--machine", "mill.toml", "--work-offset", "G45=1,2,3")
    done = shop(*words, *options)
    assert done.status == 2, done.shown
    assert "work offset G45 was given and is not used" in done.err
    assert not Path("out.nc").exists()


def test_all_that_is_used_is_given(shop):
    given = ("--work-offset", "G54=1,2,3", "--work-offset", "G55=1,2,3", "--tool-length", "T1=50")
    done = shop("part.nc", "--machine", "mill.toml", "-c", "cal.json", *given, "-o", "out.nc", "--json", "-")
    assert done.status == 0, done.shown
    assert "work offset G55 was given and is not used" in json.loads(done.out)["notes"]


def test_a_folder_says_first_what_none_of_its_programs_uses(shop):
    Path("posted").mkdir()
    for name in ("a.nc", "b.nc"):
        Path("posted", name).write_text(ISO)
    options = ("--machine", "mill.toml", "-c", "cal.json", "--jobs", "1")
    done = shop("batch", "posted", "out", *options, "--work-offset", "G45=1,2,3", "--quiet")
    assert done.status == 2
    assert done.shown.strip().splitlines()[0].startswith("NOT USED BY ANY PROGRAM: work offset G45 was given")
    Path("posted", "b.nc").write_text(ISO.replace("G54", "G55"))
    done = shop("batch", "posted", "out", *options, "--work-offset", "G55=1,2,3", "--quiet")
    assert done.status == 0, done.shown
    assert "NOT USED" not in done.shown


@pytest.mark.usefixtures("shop")
def test_from_python():
    setup = library.set_up("mill.toml", work_offset=["G45=1,2,3"])
    with pytest.raises(library.UserError, match="work offset G45 was given and is not used"):
        library.correct("part.nc", "mill.toml", "cal.json", setup=setup)
    assert library.correct("part.nc", "mill.toml", "cal.json", setup=setup, one_of_several=True).text
