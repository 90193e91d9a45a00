"""Other people's programs that read what ncomp writes, wrapped for tests."""
