"""Readers of the files of controls, one module for each of `formats/`; they share no code with the writers."""
