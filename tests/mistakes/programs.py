"""Mistakes in NC programs and in the choice of the file."""

from __future__ import annotations

from tests.mistakes.mistake import PROGRAM, Mistake, program

TAIL = "--machine gantry -c cal.json --set-up-zero -o out.nc"
KLARTEXT = "0 BEGIN PGM P MM\n1 TOOL CALL 1 Z S1000\n2 L X+10 Y+10 R0 FMAX\n3 END PGM P MM\n"


def line(made: str, block: str, cause: str, cure: str, place: str = "in.nc:9: ") -> Mistake:
    """A mistake in the ninth line of the program."""
    return Mistake(made, f"in.nc {TAIL}", place, cause, cure, (program(block),))


def file(made: str, name: str, content: str | bytes, cause: str, cure: str, place: str = "") -> Mistake:
    """A file that is no program, or another one."""
    return Mistake(made, f"{name} {TAIL}", place or f"program {name}", cause, cure, ((name, content),))


MISTAKES = (
    line("two decimal points", "N70 X200.0.5 Y150.", ".5: the number has no address", "write the address"),
    line("letter O for a zero", "N70 X2OO. Y150.", "column 8: 'O. Y150.' is not understood", "digit 0 in place of"),
    line("decimal comma", "N70 X200,5 Y150.", "column 9: ',5 Y150.' is not understood", "write the decimal point as '.'"),
    line("comment that is not closed", "N70 X200. (finish Y150.", "parentheses that do not match", "in one pair"),
    line("variable that nobody sets", "N70 X#101 Y150.", "#101 is not set by the program", "set it before this block"),
    line("X twice", "N70 X200. X210.", "the block has two X words", "write one of them"),
    line("X without a number", "N70 X Y150.", "'Y150.' is not understood", "X has no value"),
    line("bracket that is not closed", "N70 X[100+5 Y150.", "'Y150.' is not understood", "close the bracket with ]"),
    line("radius that is too small", "N70 G2 X400. Y150. R10.", "no circle of this radius", "write a larger radius"),
    line("centre that does not fit", "N70 G2 X150. Y150. I5. J0.", "the arc is no circle", "correct its end or its centre"),
    line("probing in the program", "N70 G31 Z5. F50", "G31 is a probing move", "probe in a program of its own"),
    line("G code that does not exist", "N70 G999 X200.", "G999 is not known", "take it out, or write its moves"),
    line("axis of another machine", "N70 X200. C45.", "machine gantry (w b X Y Z t) has no axis C", "check --machine"),
    line("inches on a millimetre set-up", "N70 G20 X200. Y150.", "X would go to 5080.0000 mm", "--no-travel-check lets it pass"),
    line("subprogram in another file", "N70 M98 P9001", "the file has no subprogram O9001", "give its folder by --subprograms"),
    line("jump to nowhere", "N70 GOTO 999", "no block with the label 999", "write it or correct the jump"),
    line("loop without its end", "N70 WHILE [#1 LT 5] DO1", "the end of this loop", "is missing: write it"),
    line("scale without a decimal point", "N70 G51 X0 Y0 Z0 P2", "the unit of a scale", "write the decimal point"),
    line("arc in polar coordinates", "N70 G16 X200. Y30.", "an arc in polar coordinates", "write G15 before it", "in.nc:10: "),
    line("Siemens word in a Fanuc program", "N70 X=R1 Y150.", "is not understood", "read as Siemens because of line 9", "in.nc:2: "),
    file("letter O for R0 in Klartext", "part.h", KLARTEXT.replace("R0", "RO"), "'O FMAX' is not understood", "digit 0 in place", "part.h:3: "),
    file("label that is not there", "part.h", KLARTEXT.replace("2 L X+10", "2 CALL LBL 5\n3 L X+10"), "no subprogram LBL 5", "write it into the file", "part.h:3: "),
    file("cycle of the machine's maker", "part.mpf", "N10 G17 G90 G54\nN20 CYCLE9999(1,2)\n", "CYCLE9999 is not known", "write the moves of this cycle", "part.mpf:2: "),
    file("empty file from a failed post", "in.nc", "", "is empty", "write it again from the CAM"),
    file("drawing in place of the program", "in.nc", "%PDF-1.7\n", "this is a PDF document", "the file that the CAM has posted"),
    file("spreadsheet in place of the program", "in.nc", b"PK\x03\x04" + bytes(60), "a spreadsheet", "the file that the CAM has posted"),
    file("saved as Unicode", "in.nc", PROGRAM.encode("utf-16"), "is UTF-16 text", "save it as plain text"),
    file("saved as Unicode without a mark", "in.nc", PROGRAM.encode("utf-16-le"), "a binary file", "the file that the CAM has posted"),
    file("packed program", "in.nc", b"\x1f\x8b\x08\0" + bytes(50), "this is a packed archive", "the file that the CAM has posted"),
    file("STEP model in place of the program", "in.nc", "ISO-10303-21;\nHEADER;\nENDSEC;\n", "this is a STEP model", "the file that the CAM has posted"),
    file("drawing exchange file in place of the program", "in.nc", "  0\nSECTION\n  2\nHEADER\n", "this is a DXF drawing", "the file that the CAM has posted"),
    file("installer in place of the program", "in.nc", b"MZ\x90\0" + bytes(60), "this is a program of a computer", "the file that the CAM has posted"),
    file("no-break space of a web page", "in.nc", PROGRAM.replace("N70 X200.", "N70\xa0X200.").encode("latin-1"), "is not understood", "a plain blank in place of the no-break space", "in.nc:9: "),
    file("minus sign of a word processor", "in.nc", PROGRAM.replace("N70 X200.", "N70 X\u2212200."), "is not understood", "the plain minus sign - in place", "in.nc:9: "),
    line("division by zero", "N70 X[100/0] Y150.", "/ has no value for 100, 0", "correct the formula"),
    Mistake("folder in place of the program", f"empty {TAIL}", "program empty", "Is a directory", "give the name of a file"),
    Mistake("input and output exchanged", f"out.nc {TAIL[:-10]} -o in.nc", "program out.nc", "the output in.nc is there", "names the program first"),
    Mistake("output name of an empty variable", f"in.nc {TAIL[:-10]} -o ''", "--output ''", "the name is empty", "name a file"),
    Mistake("full disk", f"in.nc {TAIL[:-10]} -o /dev/full", "cannot write /dev/full", "No space left", "make room on the disk"),
    Mistake("folder in place of the output", f"in.nc {TAIL[:-10]} -o empty", "cannot write empty", "Is a directory", "give the name of a file"),
    Mistake("folder in place of the calibration", "in.nc --machine gantry -c empty -o out.nc", "calibration empty", "Is a directory", "give the name of a file"),
    Mistake("program given twice", "in.nc in.nc --machine gantry -c cal.json --set-up-zero -o empty", "in.nc and in.nc", "have the same name", "name each once"),
    Mistake("tool twice in the table", "in.nc --machine gantry -c cal.json --work-offset G54=0,0,0 -o out.nc --tool-table t.tbl", "tool table t.tbl:2", "T1 is in the table twice", "delete one line", (("t.tbl", "T1 P1 Z80\nT1 P2 Z90\n"),)),
    Mistake("temperature of the page that is no number", f"in.nc {TAIL} --report a.html --report-head h.toml", "report head h.toml:2", "nan is not finite", "write a number", (("h.toml", "[report]\ntemperature = nan\n"),)),
    Mistake("head of the page saved in Latin-1", f"in.nc {TAIL} --report a.html --report-head h.toml", "report head h.toml", "not UTF-8 text", "save it as UTF-8", (("h.toml", b"[report]\noperator = \"M\xfcller\"\n"),)),
    Mistake("program in place of the head of the page", f"in.nc {TAIL} --report a.html --report-head in.nc", "report head in.nc", "this is an NC program", "give one"),
    Mistake("measurement in place of the program", f"data.csv {TAIL}", "program data.csv", "this is a measurement file", "ncomp fit and ncomp diagnose read it"),
    Mistake("calibration in place of the program", f"cal.json {TAIL}", "program cal.json", "this is a calibration of ncomp", "(--calibration)"),
    Mistake("corrected once more", f"done.nc {TAIL}", "done.nc:3", "already corrected by ncomp", "--force corrects it again"),
    line("subprogram that calls itself", "N70 M98 P7", "call each other more than 100 deep", "end the recursion"),
    line("number with an exponent", "N70 X2e2", "the effect of E in a move depends on the control", "leave it out"),
    line("finger on the key", f"N70 X{'9' * 400}. Y150.", "X has a number that no control reads", "write one below"),
    line("brackets without end", f"N70 X{'[' * 5000}1{']' * 5000}", "nested too deeply", "split it into several blocks"),
    file("Siemens assignment without a value", "part.mpf", "N10 G17 G90 G54\nN20 G0 X=\nM30\n", "column 9: '=' is not understood", "correct the block", "part.mpf:2: "),
    file("axis letter as a variable", "part.mpf", "N10 G17 G90 G54\nN20 DEF INT N\nM30\n", "N is an address", "write a longer name", "part.mpf:2: "),
    file("message that is not closed", "part.mpf", 'N10 G17 G90 G54\nN20 MSG("open\nM30\n', "is not understood", "correct the block", "part.mpf:2: "),
    file("circle without its centre", "part.h", KLARTEXT.replace("3 END", "3 C X+20 Y+10 DR+\n4 END"), "has no pole", "write CC before it", "part.h:4: "),
    file("parameter without its formula", "part.h", KLARTEXT.replace("2 L X+10 Y+10 R0 FMAX", "2 FN 0: Q1 ="), "the block is not complete", "complete it", "part.h:3: "),
    file("program of another file", "part.h", KLARTEXT.replace("3 END", "3 CALL PGM OTHER.H\n4 END"), "its file is not in the folder of the program", "give its folder by --subprograms", "part.h:4: "),
    file("zero byte within a line", "in.nc", PROGRAM.replace("X200.", "X200.\0"), "is a binary file", "the file that the CAM has posted"),
    Mistake("device that never ends", f"/dev/zero {TAIL}", "program /dev/zero", "blank or NUL characters", "the file that the CAM has posted"),
)  # fmt: skip
