"""The present answers of the commands: runs, how each is carried out, and the stored files that a test compares."""
