"""Reproducible uncertainty analysis for robot manipulators, from raw instrument logs to figures."""
