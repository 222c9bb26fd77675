"""Options of a depth camera."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.core.options.analysis import Bounds, Count, Positive
from pipeline.core.options.motion_capture import Pose
from pipeline.core.validation import Fault, options


@options()
class Workspace:
    """What of the scene is the arm, in the frame of its plane (see
    :class:`pipeline.perception.segment.Crop`).
    """

    half_depth: float  # m
    girth: float  # m
    column_half_width: float  # m
    column_top: float  # m
    floor: float  # m
    min_pixels: int
    max_points: int


@options(kw_only=True)
class Depth:
    """A depth camera's takes: folders of images or point clouds, with an index or with numbers in
    their names, or ROS bags.
    """

    takes: str  # glob of the takes' folders or bags
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
    width: Count | None = None  # px, of the images; null for clouds
    height: Count | None = None  # px
    encoding: Literal[
        "plain", "rotated_bits", "disparity"
    ]  # plain, rotated_bits (SUN RGB-D) or disparity (NYU Depth v2)
    units_per_metre: Positive  # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres
    # stored value from which on there is no depth, as there is none at 0
    saturation: float | None = None
    scale_key: str | None = None  # name of a factor in the description of each TIFF
    disparity: Bounds | None = None  # a and b of depth = a/(b - disparity), m
    rate: Positive  # 1/s
    # s on the camera's clock as the motion capture starts; null: at its first frame
    start: float | None = None
    # s to add to the camera's clock so started to read the motion capture's; null: estimated
    clock_offset: float | None = None
    # camera (x right, y down, z forward), or the clouds' frame, in the arm's base frame
    camera: Pose
    workspace: Workspace
    search: Annotated[
        float, Field(ge=0)
    ]  # s, the clocks' offset is looked for between -search and +search

    @model_validator(mode="after")
    def _one_source_of_times(self) -> Self:
        if self.index is not None and self.frames is not None:
            raise Fault("frames", "index and frames exclude each other: both give the times")
        return self

    @model_validator(mode="after")
    def _parameters_of_a_disparity(self) -> Self:
        if (self.disparity is not None) != (self.encoding == "disparity"):
            message = "the encoding disparity, and no other, needs [a, b] of depth = a/(b − δ)"
            raise Fault("disparity", message)
        return self
