"""Circular tests with a ballbar: the figures of ISO 230-4, and the shares of the causes of a deviation."""
