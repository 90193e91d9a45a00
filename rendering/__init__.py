"""One report of a result: shown on the terminal, or written as a page."""
