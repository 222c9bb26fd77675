"""The type of what a datasheet says about its recordings beside the keys of the dataset: text that
nothing computes with.
"""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING


@dataclass
class About:
    subject: str = MISSING  # what was recorded: robot, instruments, motion
    source: str = MISSING  # who recorded it, and where it comes from
    licence: str = MISSING  # on which terms others may use it
