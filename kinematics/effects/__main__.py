"""`python -m kinematics.effects` prints the table of effects, docs/effects.md."""

import sys

from kinematics.effects.describe import markdown

sys.stdout.write(markdown())
