"""Commands that read NC programs and controller tables."""
