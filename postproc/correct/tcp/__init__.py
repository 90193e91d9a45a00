"""Programs of the tool point (TCP) as programs of axis positions, and back."""
