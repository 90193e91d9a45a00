"""Forward kinematics of the DMU 50 by thesis (3.19)-(3.24)."""

import numpy as np


def thesis_forward(X, Y, Z, B, C, d=154.996):
    """Thesis (3.19)-(3.24): tool axis i, j, k and tool point x, y, z; angles in rad."""
    sB, cB, sC, cC, r2 = np.sin(B), np.cos(B), np.sin(C), np.cos(C), np.sqrt(2.0)
    axis = [(r2 * cC * sB - sC * cB + sC) / 2, (r2 * sC * sB + cC * cB - cC) / 2, 0.5 + cB / 2]
    s = Y + Z - d
    x = r2 / 2 * (X * sC + s * cC) * sB + (-Y + Z - d - s * cB) * sC / 2 + X * cC * cB
    y = r2 / 2 * (s * sC - X * cC) * sB + X * sC * cB + (s * cC * cB + (Y - Z + d) * cC) / 2
    z = (-r2 * X * sB + s * cB - Y + Z + d) / 2
    return np.stack([x, y, z], -1), np.stack(axis, -1)
