"""Errors that change with time, temperature or duty: each is a place (`where.py`) and a course (`when.py`)."""
