"""Machines as chains of axes: forward and inverse kinematics, error models, the error transform."""
