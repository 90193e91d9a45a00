"""Location errors of rotary axes as the kinematic parameters of controls: written, read, and their remaining errors."""
