"""Programs that measure spheres with a touch probe, for four controls."""
