"""A new joint log is cut and brought in phase as the dataset's own were."""

from __future__ import annotations
