"""Commands that set up the workplace: machines, jobs, and the check of the installation."""
