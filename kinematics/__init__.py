"""Machines as chains of axes: forward and inverse kinematics, error models, the error transform."""

from kinematics.running.blas import one_thread

one_thread()
