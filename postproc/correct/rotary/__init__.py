"""Feed moves of rotary axes alone."""
