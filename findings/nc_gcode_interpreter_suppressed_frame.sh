#!/bin/sh
# nc-gcode-interpreter 0.2.8 (CEAD) moves machine coordinates by the programmed frame, without a warning.
#
# Expected, by SINUMERIK's programming manual: SUPA, G153 and G53 suppress the frames of their block, so after
# TRANS Z-300 the block SUPA G0 Z500 goes to 500, as a retract before a tool change does.
# Seen: 200 for each of the three. The output has a column that says that the frame was suppressed, and nothing is said
# on standard error, where the same interpreter warns of G91 and of polar coordinates.
# It matters where the interpreter is a check against collisions: the retract looks lower than it is, or higher.
#
# Needs Python 3.12 or later (PYTHON=...) and a package index.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.12}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet nc-gcode-interpreter==0.2.8 polars==2.1.0

cat > "$folder/expected" <<'END'
SUPA retracts to 200.0
G153 retracts to 200.0
G53 retracts to 200.0
without TRANS: 500.0
END

"$folder/venv/bin/python" - > "$folder/seen" 2> "$folder/warnings" <<'END'
import nc_gcode_interpreter


def last_z(program):
    frame, _ = nc_gcode_interpreter.nc_to_dataframe(program)
    return frame["Z"].to_list()[-1]


for code in ("SUPA", "G153", "G53"):
    print(code, "retracts to", last_z(f"TRANS Z-300\nG0 Z10\n{code} G0 Z500\n"))
print("without TRANS:", last_z("G0 Z10\nSUPA G0 Z500\n"))
END

cat "$folder/seen" "$folder/warnings"
diff "$folder/expected" "$folder/seen"
test ! -s "$folder/warnings"
