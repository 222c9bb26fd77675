"""The type of the limits that a take must keep to: each is one measure of the table ``takes``, by
its name.
"""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.errors import ConfigError


@dataclass
class Limits:
    """What a take may have at most, in size; a take beyond any is left out. Null: no limit."""

    missing_share: float | None = None  # of the samples of the labelled markers
    # frames in a row without joint angles, up to mocap.max_gap; null: a take beyond that is refused
    longest_gap: int | None = None
    relabelled_share: float | None = None  # of the samples of the labelled markers
    residual_rms: float | None = None  # m, of the rigid-body fits
    dropped_share: float | None = None  # of the depth frames
    clock_offset_standard_error: float | None = None  # s, where the offset is estimated
    clock_drift: float | None = None  # s/s, likewise
    # s, of a joint log; see joint_log.disturbed_beyond and residual_limit for its others
    lag_behind_command: float | None = None

    def __post_init__(self) -> None:
        for name, limit in vars(self).items():
            if limit is not None and not limit >= 0:
                raise ConfigError(
                    f"{name}: a limit is not negative, as {limit} is", key=f"dataset.limits.{name}"
                )
