"""The figures of a machine over time: changes, drift, forecasts, limits."""
