"""HEIDENHAIN Klartext programs."""
