#!/bin/sh
# Linux and macOS: a posted program, corrected by ncomp. Call it with the posted file:
#     after_post.sh posted/part.posted
# The CAM writes part.posted, and ncomp alone writes part.nc: complete, or not at all. An older part.nc is removed first.
NCOMP=${NCOMP:-ncomp}
OPTIONS=${OPTIONS:---machine mill.toml --calibration cal.json}
case $1 in
*.nc)
    echo "ncomp: let the post write .posted: $1 has the name of the corrected program" >&2
    exit 2
    ;;
esac
rm -f "${1%.*}.nc" || exit 2
# shellcheck disable=SC2086  # several options
$NCOMP correct "$1" -o "${1%.*}.nc" $OPTIONS || {
    echo "ncomp: no program was written" >&2
    exit 2
}
