"""Chain, poses and step of tests/planar_poses.py as fixtures."""

from planar_poses import chain, poses, step

__all__ = ["chain", "poses", "step"]
