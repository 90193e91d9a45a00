"""The fit of an error model to a measurement, and the checks of its result."""
