"""The version of ncomp."""

VERSION = "0.1.0"
