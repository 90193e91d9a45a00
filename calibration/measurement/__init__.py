"""Measurements: columns of states and observations, from files of any known format."""
