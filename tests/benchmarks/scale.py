"""A fleet's takes, a filter of very many particles and a share of the large survey, really run, and
what more would need: ``python tests/benchmarks/scale.py`` writes reports/benchmarks/scale.json. It
has to stand in the folder of the project, after a run of the paper.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.append(str(Path(__file__).parents[1]))
sys.path.append(str(Path(__file__).parents[2]))
import pipeline.core  # noqa: F401 - before numpy: it fixes the arithmetic

import fleet  # isort: skip
import large_survey
import many_particles
from cost_growth import in_a_process
from machine import machine
from on_paper import Needs, beyond
from on_paper import machine as resources
from scenario import ROOT

OUT = ROOT / "reports/benchmarks/scale.json"
MANY = 1e8  # takes, particles and conditions on paper
WORKERS = 3


def fleets(folder: Path, takes: int, particles: int = 1000) -> dict[str, object]:
    """A fleet of ``takes`` beside one of a tenth, each in a process of its own, and many on
    paper.
    """
    few, many = (
        in_a_process(fleet.run, folder / str(count), count, particles)
        for count in (takes // 10, takes)
    )
    more = many["takes"] - few["takes"]
    # what the allocator leaves more or less of is no growth
    grows = max(many["peak_bytes"] - few["peak_bytes"], 0.0) / more
    each = Needs(grows, many["kept_bytes"] / takes, sum(many["seconds"].values()) / takes)
    fixed = Needs(few["peak_bytes"], 0.0, 0.0)
    return {"few": few, "many": many, "on_paper": beyond(MANY, fixed, each, resources(folder))}


def crowd(folder: Path, particles: int) -> dict[str, object]:
    """A filter of ``particles``, and one of many on paper."""
    measured = many_particles.run(particles)
    time = measured["seconds_many"] * measured["steps"]
    each = Needs(measured["bytes_of_a_particle"], 0.0, time)
    paper = beyond(MANY, Needs(0.0, 0.0, 0.0), each, resources(folder))
    return measured | {"on_paper": paper}


def surveyed(folder: Path, conditions: int, alone: int) -> dict[str, object]:
    """A share of the large survey, its whole grid and many conditions on paper."""
    measured = large_survey.run(folder, conditions, alone, WORKERS)
    spent = sum(measured["spent_seconds"].values()) / conditions
    each = Needs(measured["bytes_of_a_name"], measured["bytes_of_a_condition"], spent)
    there, nothing = resources(folder), Needs(0.0, 0.0, 0.0)
    paper = {"grid": measured["grid"], "many": MANY}
    return measured | {
        f"{name}_on_paper": beyond(items, nothing, each, there) for name, items in paper.items()
    }


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
            # processes are forked for these, which one that has talked to a cluster must not be
            "particles": crowd(folder, sizes.particles),
            "fleet": fleets(folder / "fleet", sizes.takes),
            "survey": surveyed(folder / "survey", sizes.conditions, sizes.alone),
        }
    sizes.out.write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main()
