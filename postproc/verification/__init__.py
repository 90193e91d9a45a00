"""Verification of a corrected program against its original: tool point errors before and after, and the best fit."""
