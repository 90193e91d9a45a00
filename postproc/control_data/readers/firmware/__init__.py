"""Readers of the firmware of printers and routers."""
