"""Corrections of many programs: those of a folder, the workers that share them, and their summary."""
