"""`ncomp serve`: a page in the browser, whose forms are the options of commands and whose results are their pages."""
