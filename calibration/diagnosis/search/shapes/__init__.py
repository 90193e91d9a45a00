"""Search for shapes: periods, pitches of sawtooth functions, fixed points, moments of jumps, finer bases."""
