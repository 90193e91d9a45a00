"""Third exam of `ncomp diagnose`: its machines, designs, effects and answers."""
