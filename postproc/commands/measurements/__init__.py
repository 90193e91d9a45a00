"""Commands that plan, simulate and predict measurements."""
