#!/bin/sh
# gcodeparser 0.3.0 reads G91.1 as G91: the mode of arc centres becomes incremental distances.
#
# Expected, by RS274/NGC (NISTIR 6556, and LinuxCNC's manual): G91.1 states that I J K are distances from the start of an
# arc and leaves G90 as it is; G59.3 is the ninth coordinate system, and G59 the sixth. FreeCAD, Fusion and others write
# G91.1 or G90.1 into the head of a program.
# Seen: the command of the line is ('G', 91), and the decimal is lost without a message, also when the line is written
# back: `gcode_str` says G91. A program in absolute coordinates looks like one in increments.
#
# Needs Python 3.9 or later (PYTHON=...) and a package index.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gcodeparser==0.3.0

cat > "$folder/expected" <<'END'
G21 G90 G91.1 -> G21, G90, G91
G90.1 -> G90
G59.3 -> G59
END

"$folder/venv/bin/python" - > "$folder/seen" 2>&1 <<'END'
from gcodeparser import parse_gcode_lines

for line in ("G21 G90 G91.1", "G90.1", "G59.3"):
    print(line, "->", ", ".join(each.gcode_str.strip() for each in parse_gcode_lines(line)))
END

cat "$folder/seen"
diff "$folder/expected" "$folder/seen"
