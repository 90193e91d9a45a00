"""Virtual machines and virtual measurements."""
