"""Options of a depth camera."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from pipeline.core.errors import ConfigError
from pipeline.core.options.motion_capture import Pose


@dataclass
class Workspace:
    """What of the scene is the arm, in the frame of its plane (see
    :class:`pipeline.perception.segment.Crop`).
    """

    half_depth: float = MISSING  # m
    girth: float = MISSING  # m
    column_half_width: float = MISSING  # m
    column_top: float = MISSING  # m
    floor: float = MISSING  # m
    min_pixels: int = MISSING
    max_points: int = MISSING


@dataclass
class Depth:
    """A depth camera's takes: folders of images or point clouds, with an index or with numbers in
    their names, or ROS bags.
    """

    takes: str = MISSING  # glob of the takes' folders or bags
    # index file in each folder; null where the frames' names are numbered, and for bags
    index: str | None = None
    frames: str | None = None  # glob of the numbered frames in each folder
    topic: str | None = None  # of the images or clouds in a bag that has several
    # topic of the intrinsics in a bag that has several, where there is no file of them
    camera_info: str | None = None
    # file of the images' calibration, from the recordings' folder; null for clouds and bags
    intrinsics: str | None = None
    # its key in that file, where that is unusual or there are several
    camera_matrix: str | None = None
    distortion: str | None = None  # likewise
    width: int | None = None  # px, of the images; null for clouds
    height: int | None = None  # px
    encoding: str = MISSING  # plain, rotated_bits (SUN RGB-D) or disparity (NYU Depth v2)
    units_per_metre: float = MISSING  # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres
    # stored value from which on there is no depth, as there is none at 0
    saturation: float | None = None
    scale_key: str | None = None  # name of a factor in the description of each TIFF
    disparity: list[float] | None = None  # a and b of depth = a/(b - disparity), m
    rate: float = MISSING  # 1/s
    # s on the camera's clock as the motion capture starts; null: at its first frame
    start: float | None = None
    # s to add to the camera's clock so started to read the motion capture's; null: estimated
    clock_offset: float | None = None
    # camera (x right, y down, z forward), or the clouds' frame, in the arm's base frame
    camera: Pose = field(default_factory=Pose)
    workspace: Workspace = field(default_factory=Workspace)
    search: float = MISSING  # s, the clocks' offset is looked for between -search and +search

    def __post_init__(self) -> None:
        if self.index is not None and self.frames is not None:
            raise ConfigError(
                "index and frames exclude each other: the times come from the one or the other",
                key="dataset.depth.frames",
            )
