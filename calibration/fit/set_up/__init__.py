"""What a file states of the set-up, compared with its data: positions of targets, zeros of runs."""
