"""Evaluation of the written moves of a program: predicted errors before and after its correction."""
