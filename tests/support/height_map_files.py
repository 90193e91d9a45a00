"""One height map as bCNC, OpenCNCPilot, gSender, Candle, Marlin, Klipper and RepRapFirmware write it."""

import json

import numpy as np

SMALL = np.array([[0.0, 0.1, 0.4], [0.2, 0.3, 0.0], [0.0, 0.5, 0.2], [0.1, 0.0, 0.3]])
"""4 x 3 heights, mm, over X 0 10 20 30 and Y 0 5 10; `[x, y]`."""


def rows(separator: str, last: str = "") -> str:
    return "".join(
        f"{10 * i:g}{separator}{5 * j:g}{separator}{SMALL[i, j]:g}{last}\n" for j in range(3) for i in range(4)
    )


def hmap() -> str:
    points = "".join(f'<point X="{i}" Y="{j}">{SMALL[i, j]}</point>' for i in range(4) for j in range(3))
    return f'<?xml version="1.0"?><heightmap MinX="0" MinY="0" MaxX="30" MaxY="10" SizeX="4" SizeY="3">{points}</heightmap>'


def gsender(units: str = "mm", lowest: float = -1e-9) -> str:
    points = [{"x": 10 * i, "y": 5 * j, "z": SMALL[i, j] or lowest} for j in range(3) for i in range(4)]
    return json.dumps({"bounds": {"minX": 0}, "points": points, "units": units})


TABLE = "\n".join(",".join(f"{z:.3f}" for z in SMALL[:, j]) for j in range(3)) + "\n"
KLIPPER = """#*# [bed_mesh default]
#*# version = 1
#*# points =
#*#   {}
#*# x_count = 4
#*# y_count = 3
#*# mesh_x_pps = {pps}
#*# mesh_y_pps = 0
#*# algo = {algo}
#*# tension = 0.2
#*# min_x = 0
#*# max_x = 30
#*# min_y = 0
#*# max_y = 10
"""
UBL = (
    "Recv: Bed Topography Report:\n\n    (0,10)      (30,10)\n        0       1       2       3\n"
    + "   |\n".join(f" {j} | " + " ".join(f"{z:+.3f}" for z in SMALL[:, j]) + "\n" for j in (2, 1, 0))
    + "        0       1       2       3\n    (0,0)       (30,0)\n"
)
FORMS = {
    "map.probe": "0 30 4\n0 10 3\n-2 1 20\n\n\n" + rows(" "),
    "map.hmap": hmap(),
    "board.gshmap": gsender(),
    "probe-results.txt": rows(" ", " 0 0 0 0 0 0"),
    "smartprobe.txt": "".join(f"G1 X{10 * i} Y{5 * j} Z{SMALL[i, j]}\n" for j in range(3) for i in range(4)),
    "list.csv": "x,y,z\n" + rows(","),
    "german.txt": rows("; "),
    "heightmap.csv": "RepRapFirmware height map file v2 generated at 2026-01-01\n"
    "axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1\nX,Y,0,30,0,10,-1,10,5,4,3\n" + TABLE,
    "v2.csv": "RepRapFirmware height map file v2\nxmin,xmax,ymin,ymax,radius,xspacing,yspacing,xnum,ynum\n"
    "0,30,0,10,-1,10,5,4,3\n" + TABLE,
    "printer.cfg": KLIPPER.format(TABLE.strip().replace("\n", "\n#*#   "), pps=0, algo="direct"),
    "g29.txt": "".join(
        f"Bed X: {10 * i}.000 Y: {5 * j}.000 Z: {SMALL[i, j]:.3f}\n" for j in range(3) for i in range(4)
    ),
    "ubl.txt": UBL,
}
