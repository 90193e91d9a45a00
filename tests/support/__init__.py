"""Cases, data and runs that several test modules use; no test module imports another one."""
