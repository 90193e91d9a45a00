#!/bin/sh
# GTC 1.5.1 (Measurement Standards Laboratory of New Zealand): abs() of an uncertain number is a plain number.
#
# Expected: an uncertain number with the same uncertainty, as of -x, x**2 and sqrt(x**2), which is what
# GTC.magnitude(x) gives. Many values of this field are absolute: the reversal value of ISO 230-2 is the largest |B_i|.
# Seen: a float. What follows is computed without its uncertainty and without a message, and a sum with other
# uncertain numbers states too small an uncertainty: here 0.1 for |x| + y, and 0.5099 with magnitude.
#
# Needs Python 3.11 or later (PYTHON=...) and a package index.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet GTC==1.5.1 numpy==2.4.6 scipy==1.17.1

cat > "$folder/expected" <<'END'
abs(x): float 2.0
u(abs(x) + y) = 0.1000
u(magnitude(x) + y) = 0.5099
u(-x + y) = 0.5099
END

"$folder/venv/bin/python" - > "$folder/seen" 2>&1 <<'END'
import GTC

x, y = GTC.ureal(-2.0, 0.5), GTC.ureal(1.0, 0.1)
print("abs(x):", type(abs(x)).__name__, abs(x))
print(f"u(abs(x) + y) = {(abs(x) + y).u:.4f}")
print(f"u(magnitude(x) + y) = {(GTC.magnitude(x) + y).u:.4f}")
print(f"u(-x + y) = {(-x + y).u:.4f}")
END

cat "$folder/seen"
diff "$folder/expected" "$folder/seen"
