#!/usr/bin/env bash
# Installs a wheel of ncomp in an empty venv of each Python from 3.11 to 3.13 of this machine, and does a whole job with
# each: `tests/wheel_in_venvs.sh dist/ncomp-0.1.0-py3-none-any.whl`. Library versions are those of requirements.lock.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
wheel=$(realpath "$1")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tried=""

for version in 3.11 3.12 3.13; do
    for python in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
        # a python on the PATH may be a stub that does not run
        "$python" -c "import ensurepip, sys; sys.exit('$version' != '%d.%d' % sys.version_info[:2])" 2>/dev/null || continue
        case "$tried" in *"$version"*) continue ;; esac
        tried="$tried $version"
        echo "--- Python $version"
        "$python" -m venv "$folder/$version"
        "$folder/$version/bin/python" -m pip install --quiet --disable-pip-version-check -c requirements.lock "$wheel[serve]"
        cd "$folder"
        export PATH="$folder/$version/bin:$PATH"
        python -c "import ncomp; assert ncomp.__file__.startswith('$folder'), ncomp.__file__"
        ncomp --version
        ncomp --version --json >log && grep -q '"numpy"' log
        ncomp doctor >log || { cat log; exit 1; }
        _NCOMP_COMPLETE=complete_bash COMP_WORDS="ncomp verif" COMP_CWORD=1 ncomp >log && grep -qx verify log
        ncomp tutorial "mill$version"
        ncomp check "mill$version/part.nc" --machine "mill$version/mill.toml" >log || { cat log; exit 1; }
        ncomp init "own$version" --name own --chain "w C A X Y b Z t" --travel X=0:500 --travel Y=-400:0 \
            --travel Z=-300:0 --travel A=-120:30 --travel C=-inf:inf --point A=250,-200,-400 --point C=250,-200,-410 \
            --work-offset G54=250,-200,-385 --tool-length T1=95 --program "../mill$version/part.nc" 2>log
        grep -q "line of C is below the spindle at X 250, Y -200" log
        setup=(--machine dmu50 --work-offset G54=-30,-20,150 --tool-length T1=80)
        ncomp "$root/examples/box.nc" "${setup[@]}" -o "box$version.nc" --report page.html 2>log || { cat log; exit 1; }
        python -m ncomp verify "$root/examples/box.nc" "box$version.nc" "${setup[@]}" >log
        head -6 log # a pipe that is closed early would end the script
        export NCOMP_HISTORY="$folder/$version.sqlite"
        ncomp history event gantry crash && ncomp history list gantry >log && grep -q crash log
        ncomp serve --port 0 2>"serve$version.log" & server=$!
        for _ in $(seq 100); do grep -q http "serve$version.log" && break || sleep 0.2; done
        page=$(grep -o 'http://[^ ]*' "serve$version.log")
        for file in task/program static/page.css static/serve.css static/serve.js; do
            python -c "import sys, urllib.request as r; sys.stdout.buffer.write(r.urlopen(sys.argv[1]).read())" "$page$file"
        done >log
        grep -q "NC program" log
        kill "$server" && wait "$server"
        ncomp simulate --machine gantry --strategy grid --points 125 --seed 1 -o data.csv
        ncomp fit data.csv --machine gantry -o "cal$version.json" --basis legendre:3 >log || { cat log; exit 1; }
        # an effect of one's own, from the recipe: a file, and an entry point of an installed package
        mkdir "own_effect$version"
        sed -n '/^```python title="overshoot.py"/,/^```$/{/^```/d;s/^from kinematics/from ncomp.kinematics/;p}' \
            "$root/docs/develop/recipes.md" >"own_effect$version/overshoot.py"
        effect=(--effect overshoot:axis=X,size=0)
        ncomp fit data.csv --machine gantry -o "own$version.json" --basis legendre:1 "${effect[@]}" \
            --plugin "own_effect$version/overshoot.py" >log || { cat log; exit 1; }
        grep -q '"plug-in overshoot.py"' "own$version.json"
        cp "own_effect$version/overshoot.py" "own_effect$version/ncomp_overshoot.py"
        { sed -n '/^```toml title="pyproject.toml"/,/^```$/{/^```/d;p}' "$root/docs/develop/recipes.md"
            printf '[tool.hatch.build]\ninclude = ["ncomp_overshoot.py"]\n[build-system]\n'
            printf 'requires = ["hatchling"]\nbuild-backend = "hatchling.build"\n'; } >"own_effect$version/pyproject.toml"
        python -m pip install --quiet --disable-pip-version-check --no-deps "./own_effect$version"
        ncomp fit data.csv --machine gantry -o "own$version.json" --basis legendre:1 "${effect[@]}" --plugin overshoot \
            >log || { cat log; exit 1; }
        grep -q '"plug-in overshoot": "ncomp-overshoot 1.0"' "own$version.json"
        ls "$folder/$version/lib/python$version/site-packages" |
            { ! grep -xE 'postproc|kinematics|calibration|grammars|history|machines|rendering'; }
        cd "$root"
    done
done
[ -n "$tried" ] || { echo "no Python from 3.11 to 3.13 was found" >&2; exit 1; }
cmp_first=$(ls "$folder"/box*.nc | head -1)
for each in "$folder"/box*.nc; do cmp "$cmp_first" "$each"; done
echo "tried:$tried; the corrected programs are the same"
