"""Every option of the laboratory is shown with what its declaration says of it."""

from __future__ import annotations

from pathlib import Path

from omegaconf import OmegaConf

from pipeline.core.config import LABORATORY
from pipeline.tools.page.card import OPTIONS
from pipeline.tools.page.option_comments import Option, parts

ROOT = Path(__file__).parents[3]
SOURCE = '''
@dataclass
class Room:
    """Sizes;
    m."""

    height: float = 2.0


@dataclass
class Sensor:
    """A sensor."""

    seen: tuple[float, float]  # m, what is seen
    rate: float = 10.0  # 1/s, of samples; a datasheet
    gain: float = 0.5
    # V and
    # V/m; assumed
    line: tuple[float, float] = (0.0, 1.0)
    room: Room = field(default_factory=Room)

    def __post_init__(self) -> None:
        self.other: int = 3  # not an option
'''


def test_an_option_has_the_comment_beside_it_or_the_lines_above_it_and_no_other():
    values = {
        "sensor": {
            "seen": [1.0, 2.0],
            "rate": 20.0,
            "gain": 0.5,
            "line": [0.0, 1.0],
            "room": {"height": 3.0},
        }
    }
    sensor, room = parts(SOURCE, {"sensor": "Sensor"}, values)
    assert (sensor.name, sensor.said, room.name, room.said) == (
        "sensor",
        "A sensor.",
        "sensor.room",
        "Sizes; m.",
    )
    assert sensor.options == [
        Option("sensor.seen", [1.0, 2.0], "m, what is seen", None),
        Option("sensor.rate", 20.0, "1/s, of samples; a datasheet", 10.0),
        Option("sensor.gain", 0.5, "", None),
        Option("sensor.line", [0.0, 1.0], "V and V/m; assumed", None),
    ]
    assert room.options == [Option("sensor.room.height", 3.0, "", 2.0)]


def test_of_every_option_of_the_laboratory_its_part_or_its_own_comment_says_something():
    values = OmegaConf.to_container(OmegaConf.load(ROOT / "data/config.yaml")).get("dataset")[
        "laboratory"
    ]
    sources = [file.read_text() for file in sorted((ROOT / OPTIONS).glob("*.py"))]
    result = parts("\n".join(sources), LABORATORY, values)
    named = [option.name for part in result for option in part.options]
    assert sorted(named) == sorted(_names(values)) and len(named) > 70
    # a girth of a finger is told by its name and the unit of its part
    assert [option.name for part in result for option in part.options if not option.said] == [
        "kinect.scene.finger_width",
        "kinect.scene.finger_depth",
    ]


def _names(values: dict, prefix: str = "") -> list[str]:
    names = []
    for key, value in values.items():
        names += _names(value, f"{prefix}{key}.") if isinstance(value, dict) else [f"{prefix}{key}"]
    return names
