"""The run of a command: progress, processes, durations, and the libraries that are installed."""
