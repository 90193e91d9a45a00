"""The public functions on NC programs and tables of controls: one for each job, `ncomp` has them under their names."""
