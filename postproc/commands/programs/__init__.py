"""Commands that read NC programs."""
