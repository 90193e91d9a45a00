"""Commanded moves as columns: kinds of moves, arcs, frames, segments, reversals."""
