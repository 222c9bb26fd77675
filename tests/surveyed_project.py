"""A project that a survey can be made of, without the run that it takes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from known_law import JOINTS, ROOT, write_project

from pipeline.core import contracts
from pipeline.core.columns import spread, triangle


def write_surveyed_project(folder: Path) -> None:
    """Where the experiment has run up to the noise of its instruments, in ``folder``, where the
    process must stand.
    """
    write_project(folder)
    frames = {"take": "none", "frame": range(4), "t": np.linspace(0.0, 3.2, 4)}
    noise = spread("b", JOINTS, np.full((4, 3), 0.01))
    noise |= triangle("r", JOINTS, np.tile(4e-4 * np.eye(3), (4, 1, 1)))
    Path("data/articulate").mkdir()
    contracts.write(pd.DataFrame(frames | noise), "kinect_noise", Path("data/articulate"))
    Path("data/raw").symlink_to(ROOT / "data/raw")
    Path("reports/studies").mkdir(parents=True)
    for name in ("claims.yaml", "datasets"):
        Path("reports", name).symlink_to(ROOT / "reports" / name)
