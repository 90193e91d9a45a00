"""The closed loop: what a model lacks, found in what a fit leaves; named, added, and held against the data."""
