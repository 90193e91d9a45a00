"""Recognition of a program's dialect, and its message: by the text outside of comments, with its line."""

import pytest

from postproc.dialects import find_dialect
from postproc.text.dialect_evidence import without_comments

FOUND = {
    # the contents of comments, parentheses and strings are no evidence
    "(a semicolon; X=5 stands in here)\nG0 X1. Y2.\n": ("iso", "because no line at its beginning"),
    "(first; second) G0 X1. (R1=5; MCALL)\n; MCALL CYCLE81(5)\n": ("iso", "because no line at its beginning"),
    "G0 X1. (open; R1=5\n": ("iso", "because no line at its beginning"),
    "G0 X1. ; (TRANS X5\nG1 X2. (X=5)\n": ("iso", "because no line at its beginning"),
    "(BEGIN PGM)\n(TOOL CALL 1)\n;CYCL DEF 7.0\nG0 X1.\n": ("iso", "because no line at its beginning"),
    "G0 X1.\nGOTO 20\nN20 X5.\n": ("iso", "because no line at its beginning"),
    "(X=5)\n#1=5\nG0 X#1\n": ("iso", "because of line 2: '#1=5'"),
    '(TOOL (id="3") X=5)\nG0 X1.\n': ("iso", "because no line at its beginning"),
    '(TOOL (a) id="3"\nG0 X1.\n': ("iso", "because no line at its beginning"),
    # names of programs are no evidence
    '<part id="3">\nG0 X1.\n': ("iso", "because no line at its beginning"),
    "O0012 <X=5>\n%PART X=5\nG0 X1.\n": ("iso", "because no line at its beginning"),
    "%_N_PART_MPF\nG0 X1\n": ("siemens", "because of line 1: '%_N_PART_MPF'"),
    "%PART\nG0 X=R1\n": ("siemens", "because of line 2: 'G0 X=R1'"),
    # the text outside of them is evidence
    "; text\nN10 G0 X1\nN20 X=R1 ; (a;b)\n": ("siemens", "because of line 3: 'N20 X=R1 ; (a;b)'"),
    'MSG("a; (b #1=2")\n': ("siemens", "because of line 1"),
    "G40 TRAFOOF D0\nG0 X1\n": ("siemens", "because of line 1: 'G40 TRAFOOF D0'"),
    "(SUPA)\nG0 X1\nSUPA G1 X2.\n": ("siemens", "because of line 3: 'SUPA G1 X2.'"),
    "G0 X1\nN5 $P_UIFR[1]=CTRANS(X,0):CFINE(X,0.01)\n": ("siemens", "because of line 2: 'N5 $P_UIFR[1]="),
    "$H\n$J=G91 X5\nG0 X1\n": ("iso", "because no line at its beginning"),
    "G0 X1\nGOTOF END1\n": ("siemens", "because of line 2: 'GOTOF END1'"),
    ";$PATH=/_N_WKS_DIR\nG0 X1\n": ("siemens", "because of line 1"),
    "; comment\n0 BEGIN PGM A MM\n1 L X+5 FMAX\n": ("heidenhain", "because of line 2: '0 BEGIN PGM A MM'"),
}


@pytest.mark.parametrize("text", FOUND)
def test_evidence(text):
    dialect, reason = FOUND[text]
    found = find_dialect("auto", "a.nc", text)
    assert found.name == dialect
    assert reason in found.evidence
    assert "--dialect overrides" in found.evidence


def test_by_the_name_of_the_file():
    assert "its name ends in .mpf" in find_dialect("auto", "A.MPF", "G0 X1\n").evidence
    assert "its name ends in .h" in find_dialect("auto", "a.h", "Q1\n").evidence
    assert find_dialect("iso", "a.mpf", "X=5").evidence == ""


def test_what_is_spoken():
    assert without_comments('G1 (a; b) X5 "c;d" ; e (f') == 'G1 ( X5 " '


def test_a_refusal_says_how_it_was_read(command, tmp_path):
    """A semicolon inside a parenthesis: read as ISO, and refused for its own fault alone."""
    (tmp_path / "a.nc").write_text("(depth; X=5 first)\nG21 G90 G54\nG999\n")
    for arguments in (("check", "a.nc"), ("a.nc", "-o", "out.nc", "--calibration", "none")):
        done = command(*arguments, "--machine", "gantry")
        text = done.out.decode() + " ".join(done.err.split())
        assert done.status == 2
        assert "G999 is not known" in text
        assert "read as ISO because no line at its beginning is Siemens or Klartext; --dialect overrides this" in text
    (tmp_path / "a.nc").write_text("G0 X1 Y=5\nG999 X1\n")
    done = command("check", "a.nc", "--machine", "gantry")
    assert "read as Siemens because of line 1: 'G0 X1 Y=5'; --dialect overrides this" in done.out.decode()
    done = command("check", "a.nc", "--machine", "gantry", "--dialect", "siemens")
    assert "read as" not in done.out.decode()
