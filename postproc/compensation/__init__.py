"""The error model applied to commanded moves: conditions, datum, deviation and correction."""
