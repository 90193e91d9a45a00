"""Compensation tables: the required correction of commands, and the tables that come nearest to it."""
