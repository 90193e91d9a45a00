"""Errors of a machine that drift, followed by repeated touches of spheres and other features."""
