"""Deviations to first order in the errors, for comparison with the exact ones."""

import numpy as np

from kinematics.deviation import Deviation
from kinematics.error_transform import error_transform_with_tool
from kinematics.machine import Machine


def first_order_deviation(machine: Machine, q, errors, tool=(0.0, 0.0, 0.0)) -> Deviation:
    """J . errors; arguments as of `exact_deviation`, of each one row serves for all."""
    motions = np.asarray(errors, float)
    motions = motions.reshape(-1, 6 * motions.shape[-2])
    rows = np.broadcast_shapes(*(np.atleast_2d(each)[:, 0].shape for each in (q, motions, tool)))
    q, motions, tool = (np.broadcast_to(each, (*rows, np.shape(each)[-1])) for each in (q, motions, tool))
    six = np.einsum("nij,nj->ni", error_transform_with_tool(machine, q, tool)[:, :, : motions.shape[1]], motions)
    return Deviation(six[:, :3], six[:, 3:])
