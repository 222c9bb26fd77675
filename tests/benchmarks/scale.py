"""A fleet's takes, a filter of very many particles and a share of the large grid, really run:
``python tests/benchmarks/scale.py`` writes reports/benchmarks/scale.json. It has to stand in the
folder of the project, after a run of the paper.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.append(str(Path(__file__).parents[1]))
sys.path.append(str(Path(__file__).parents[2]))
import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

import fleet  # isort: skip
import large_grid
import many_particles
from cost_growth import in_a_process
from machine import machine
from on_paper import resources
from scenario import ROOT

OUT = ROOT / "reports/benchmarks/scale.json"
WORKERS = 3


def fleets(folder: Path, takes: int, particles: int = 1000) -> dict[str, object]:
    """A fleet of ``takes`` beside one of a tenth, each in a process of its own."""
    few, many = (
        in_a_process(fleet.run, folder / str(count), count, particles)
        for count in (takes // 10, takes)
    )
    return {"few": few, "many": many}


def main() -> None:
    """Measure and write; the sizes can be smaller, for trying out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--takes", type=int, default=10_000)
    parser.add_argument("--particles", type=int, default=1_000_000)
    parser.add_argument("--conditions", type=int, default=36)
    parser.add_argument("--alone", type=int, default=6, help="of the conditions, in one process")
    parser.add_argument("--out", type=Path, default=OUT)
    sizes = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        measured = {
            "machine": machine(),
            "there": asdict(resources(folder)),
            # processes are forked for these, which one that has talked to a cluster must not be
            "particles": many_particles.run(sizes.particles),
            "fleet": fleets(folder / "fleet", sizes.takes),
            "grid": large_grid.run(folder / "grid", sizes.conditions, sizes.alone, WORKERS),
        }
    sizes.out.write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main()
