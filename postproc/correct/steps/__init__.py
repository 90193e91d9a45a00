"""The steps of a correction: to correct moves, to check them, to count the results, and to write the program."""
