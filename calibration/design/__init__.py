"""The linear design of a measurement: its equations, random machines and batches of fits."""
