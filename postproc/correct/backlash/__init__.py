"""Axes with backlash: where their drives must go, and the blocks and cuts that bring them there."""
