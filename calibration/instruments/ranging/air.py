"""The refractive index of air, by which ranges that refer to one index are converted to that of their row.

The updated Edlen equation, with the terms of Birch and Downs (Metrologia 31, 1994) and of Stone and Zimmerman for the
water vapour (NIST, Engineering Metrology Toolbox, A-IV): 3e-8 for 5 to 30 degC, 600 to 1200 hPa and visible light. The
saturation pressure is that of Buck (1996).
"""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array

HELIUM_NEON_NM = 632.991
"""Wavelength of a helium-neon laser in vacuum, nm."""


def refractive_index(
    temperature_deg_c: Array, pressure_hpa: Array, humidity_percent: Array, wavelength_nm: float
) -> Array:
    """Refractive index of air `(n,)`."""
    t, p, s = temperature_deg_c, pressure_hpa * 100.0, (1e3 / wavelength_nm) ** 2
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - s) + 15998.0 / (38.9 - s))
    density = p * (1.0 + 1e-8 * (0.601 - 0.00972 * t) * p) / (1.0 + 0.003661 * t) / 96095.43
    vapour = humidity_percent / 100.0 * 611.21 * np.exp((18.678 - t / 234.5) * t / (257.14 + t))
    return np.asarray(1.0 + density * standard - 1e-10 * 292.75 / (t + 273.15) * (3.7345 - 0.0401 * s) * vapour)
