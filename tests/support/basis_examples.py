"""An example of every kind of basis."""

from kinematics.basis import BSpline, Fourier, Harmonics, Legendre, Polynomial

NODES = (-250.0, -200.0, -199.0, 0.0, 13.5, 250.0)
BASES = {
    "constant": Polynomial((0.0, 1.0), 0),
    "polynomial": Polynomial((-250.0, 250.0), 4),
    "legendre": Legendre((0.0, 400.0), 6),
    "no harmonics": Fourier((0.0, 360.0), ()),
    "fourier": Fourier((0.0, 360.0), (2.0, 4.0)),
    "harmonics": Harmonics((-90.0, 270.0), 3),
    "half waves": Fourier((-110.0, 110.0), (1.0, 1.5)),
    "table": BSpline(NODES, 1),
    "two values": BSpline((0.0, 5000.0), 1),
    "cubic spline": BSpline(NODES, 3),
    "one cubic": BSpline((0.0, 1.0), 3),
}
