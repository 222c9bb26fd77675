"""The chain of tests/planar_poses.py as a fixture."""

from planar_poses import chain

__all__ = ["chain"]
