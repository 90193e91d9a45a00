"""Continuous-motion laser runs of one axis, fused with a quasi-static measurement into one error table."""
