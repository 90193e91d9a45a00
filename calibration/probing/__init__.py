"""Plans of touch-probe measurements on spheres: rotary positions, touches, and moves that avoid spheres and stems."""
