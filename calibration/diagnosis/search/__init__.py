"""The search for effects that a model lacks."""
