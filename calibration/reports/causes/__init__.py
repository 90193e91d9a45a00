"""Causes of a diagnosis in words, figures and views."""
