#!/bin/sh
# Linux and macOS: a posted program, corrected by ncomp. Call it with the posted file:
#     after_post.sh posted/part.posted
# The CAM writes part.posted, and ncomp alone writes part.nc: complete, or not at all. An older part.nc is removed first.
# Machine and calibration lie beside this file, or have their whole paths.
NCOMP=${NCOMP:-"ncomp"}
OPTIONS=${OPTIONS:---machine mill.toml --calibration cal.json}
case $1 in
*.nc)
    echo "ncomp: let the post write .posted: $1 has the name of the corrected program" >&2
    exit 2
    ;;
esac
posted=$(cd "$(dirname "$1")" && pwd)/$(basename "$1") && cd "$(dirname "$0")" || exit 2
rm -f "${posted%.*}.nc" || exit 2
# shellcheck disable=SC2086  # several options
"$NCOMP" correct "$posted" -o "${posted%.*}.nc" $OPTIONS || {
    echo "ncomp: no program was written" >&2
    exit 2
}
