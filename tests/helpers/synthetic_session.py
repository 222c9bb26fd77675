"""The arm and the motion of the dataset youbot_sway, as its own options give them."""

from planar_poses import load_arm

from pipeline.configuration.config import CONF, dataset_values
from pipeline.laboratory.causes import sway
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions

DATASET = dataset_values(CONF / "dataset" / "youbot_sway.yaml")
ROBOT = DATASET["robot"]
LABORATORY = DATASET["laboratory"]
ARM = load_arm(ROBOT["urdf"], ROBOT["joints"], ROBOT["tool"], ROBOT["locked"])
TRAJECTORY = TrajectoryOptions(**LABORATORY["trajectory"])
DYNAMICS = sway.Options()  # with every disturbance
# without any disturbance; 200 steps a second are enough for what is smooth
SIZES = "length encoder_offset speed_error start jitter".split()
SILENT = {f"{name}_std": 0 for name in SIZES} | {"encoder_ripple": 0, "clearance": 0}
QUIET = DynamicsOptions(rate=200.0, sway_std=(0, 0, 0), **SILENT)
