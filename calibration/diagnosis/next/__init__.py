"""Proposed measurements that distinguish the remaining causes."""
