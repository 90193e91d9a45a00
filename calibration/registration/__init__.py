"""The points that an instrument sees, and the unknown pose of the instrument: what instruments are written with."""
