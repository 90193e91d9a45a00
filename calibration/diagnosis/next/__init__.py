"""Measurements that would decide between the remaining causes."""
