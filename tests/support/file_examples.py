"""Valid input files: a program, measurements, maps, tables and studies."""

PROGRAM = "%\nO1 (A)\nG21 G17 G90\nG0 X100.0 Y100.0 Z100.0\nG1 X200.0 F500\nG2 X200.0 I10.0 J0\nM30\n%\n"
"""A program of the gantry."""

RTL = """\
HEADER::
File type: LASER
Owner: Renishaw plc

TARGET DATA::
Filetype  : ISO
Target-count: 6
Targets :
 0.000  100.000  200.000  300.000  400.000
 500.000
Flags: 0 0 2 0

USER-TEXT::
Machine:   mill
Date:12:30 2001-02-03
Axis:X

RUNS::
Run-count: 4

DEVIATIONS::
Run Target Data:
""" + "".join(
    f" {run}   {target}      {run + target / 10:.1f}\n"
    for run in (1, 2, 3, 4)
    for target in (range(1, 7) if run % 2 else range(6, 0, -1))
) + "\nENVIRONMENT::\nAir temp   : 20.1\n\nEOF::\n"  # fmt: skip
WIDE = """\
# axis: X
# unit: um
# u_um: 0.3
# target.r: 0 0 -60
target_mm;1 up;1 down;2 up;2 down
0;0,5;-2,25;0,4;-2
100;1;;1,5;-1,5
"""
CMM = """\
Plug Plate: 1597A
Date: 2003-10-17

    Meas X    Meas Y     Nom X     Nom Y     Err X     Err Y  Meas D   Nom D   Round
   -73.126   121.717   -73.140   121.705     0.014     0.012   2.174   2.167   0.007
   231.288   204.188   231.279   204.187     0.009     0.001   2.171   2.167   0.018
"""
MAP = """\
delimiter = ","
decimal = "."
[columns]
X = 1
C = 2
temp_air = 3
time_s = 4
actual_C = 5
x = 6
y = 7
z = 8
dir_X = 9
[units]
linear = "inch"
rotary = "rad"
temperature = "K"
time = "ms"
xyz = "um"
[header]
instrument = "laser-tracker"
u_range_um = 0.5
u_angle_um = 5
stands_on = "bed"
target.t1 = "0 0 -120"
"""
ETALON = """\
// made up
[C0Y]
VALUE = 0.000022
[X0C]   // position of the axis line
VALUE = -0.01
[EXX]
Gridpoints = {
    -250.0 -0.001
       0.0  0.0005   // in the middle
     250.0  0.002
}  // end of EXX
[ECC]
Gridpoints = {
    0 0.00001
    360 0.00002
}
"""


TRACKER = """\
# machine: gantry
# instrument: laser-tracker
# u_range_um_per_m: 0.25
# u_angle_um: 5
# u_angle_um_per_m: 1
# target.t1: 0 0 -120
# target.t2: 90, 40, -180
time_s,X,Y,Z,target,x,y,z,temp_scale
0.0,0.0000,0.0000,0.0000,t1,-110.73612,-3221.43193,-862.87697,20.00
8.0,500.0,0.0000,0.0000,t2,389.2,-3221.4,-862.8,20.50
16.0,200.0,0.0000,0.0000,t1,89.2,-3221.4,-862.8,21.00
"""
INTERFEROMETER = """\
# machine: dmu50
# instrument: interferometer
# u_um: 0.3
# u_um_per_m: 0.5
# target.r: 0 0 -50
axis,run,direction,target_mm,target_deg,deviation_um,deviation_urad,C
X,1,+1,-100,,0.5,,30
X,1,forward,100,,1.5,,30
X,1,-,100,,-2.25,,30
X,2,backward,-100,,1,,30
C,1,+,,90,,12.5,90
"""
PART = """\
# machine: gantry
# instrument: part
# u_um: 2.5
# part_offset: 500 600 300
# target.mill: 0 0 -100
nominal_x,nominal_y,x,y
0,0,0.001,0.002
10,0,10.003,0.004
"""


LASER = "# axis: X\n# unit: um\ntarget_mm;1 up;1 down;2 up;2 down\n" + "".join(
    f"{100 * i};{i};{i - 2};{i + 0.5};{i - 1.5}\n" for i in range(5)
)


TNC410 = """\
BEGIN TOOL    .T       MM
T    NAME             L          R          DL      DR      TL RT  TIME1 TIME2 CUR.TIME DOC
0                     +0,000     +0,000     +0,000  +0,000         0     0     0
1    14MM_CRB_4FL_32_ +95,100    +7,000     +0,000  +0,000         0     0     0
5    14MM_CRB_4FL_BM_ -4,686     +7,000     +0,020  -0,425         0     0     2        X+1 ; Y
12                    +18,892    +3,000     +0,000  +0,000         0     0     0
"""
PRESETS = """\
BEGIN PRESET .PR MM
NO   DOC          SPA      SPB      SPC      X           Y           Z           B        C
0                 +0       +0       +0       +0          +0          +0          +0       +0
1    VICE         +0       +0       +2.5     +12.5       -80         +210,25     +0       +30
2    PLATE        +0       +0       +0       +1          +2          +3
[END]
"""


STUDY = """
machine = "gantry"
draws = 60
seed = 5
[fit]
basis = "legendre:4"
prior = 30
[[case]]
name = "few"
strategy = "hexahedron"
points = 100
tracker = [-1500, 1500, 300]
[[case]]
name = "more"
strategy = "hexahedron"
points = 200
tracker = [-1500, 1500, 300]
"""
