"""What the report says of great numbers that were really run, and of greater ones on paper."""

from __future__ import annotations

import json
from pathlib import Path

from on_paper import DAY, papers
from writing import duration, table

TITLE = "At scale"
NAMES = {"memory": "memory", "disk": "disk", "files": "files", "time": "a day of every core"}


def section(folder: Path) -> str:
    """Of scale.json, which `make bench-scale` writes."""
    file = folder / "scale.json"
    if not file.exists():
        return "Not measured yet: `make bench-scale`."
    measured = json.loads(file.read_text())
    texts = [crowd(measured["particles"]), fleets(measured["fleet"])]
    texts += [gridded(measured["grid"])] if "grid" in measured else []
    texts.append(on_paper(measured))
    return f"On {measured['machine']}.\n\n" + "\n\n".join(texts)


def crowd(measured: dict) -> str:
    """A filter of very many particles."""
    return (
        f"**One filter of {measured['many']:,} particles** takes "
        f"{duration(measured['seconds_many'])} a particle and step, one of {measured['few']:,} "
        f"{duration(measured['seconds_few'])}, and holds "
        f"{measured['bytes_of_a_particle']:.0f} bytes a particle, {size(measured['peak_bytes'])} "
        "in all."
    )


def fleets(measured: dict) -> str:
    """The takes of a fleet."""
    few, many = measured["few"], measured["many"]
    takes = many["takes"]
    parts = ", ".join(
        f"{name} {duration(seconds / takes)}" for name, seconds in many["seconds"].items()
    )
    return (
        f"**{takes:,} takes of a simulated fleet**, {many['steps']} steps each, go through noise, "
        f"fit and filter ({many['particles']:,} particles) in one process of "
        f"{size(many['peak_bytes'])} at its peak; {few['takes']:,} takes need "
        f"{size(few['peak_bytes'])}. A take costs {parts} of processor time, and "
        f"{many['kept_bytes'] / takes / 1e3:.1f} kB are kept of it. Takes are written and read in "
        "blocks; the fit is made of sums over the takes, the posterior is written block by block. "
        f"The fit finds σ_B {many['sigma_b']:.4f} by the paper's estimator, from {few['takes']:,} "
        f"takes {few['sigma_b']:.4f} (drawn with {many['true_sigma_b']}); the filter's mean is "
        f"{many['off_the_filter_rad']:.4f} rad off the measured poses, that of the takes "
        f"{many['off_the_mean_rad']:.4f} rad."
    )


def gridded(measured: dict) -> str:
    """A share of the large grid on a cluster."""
    return (
        f"**The large grid of the study `robustness`** has {measured['grid']:,} conditions of "
        f"about {duration(measured['seconds_a_condition'])} of processor time each; "
        f"{measured['conditions']} drawn by chance were run on a cluster of {measured['workers']} "
        "workers of which one was killed by its process id after the first result "
        f"({measured['workers_left']} were left): {duration(measured['seconds_by_the_clock'])} by "
        f"the clock. Of the {measured['alone']} that were run in one process too, "
        f"{measured['equal_bytes']} have equal bytes."
    )


def on_paper(measured: dict) -> str:
    """Greater numbers, by the slopes that were measured."""
    rows = [
        [
            what,
            f"{paper.items:.2g}",
            size(paper.needs.memory),
            size(paper.needs.disk) if paper.needs.disk else "–",
            f"{paper.needs.files:.2g}" if paper.needs.files else "–",
            f"{paper.needs.time / DAY:.2g}",
            f"{NAMES[paper.ends_first]}, at {paper.enough_for:.2g}",
        ]
        for what, paper in papers(measured).items()
    ]
    there = measured["there"]
    header = ["of", "how many", "memory", "disk", "files", "days of a core", "what ends first here"]
    return (
        "On paper, by the slopes of what was run; the time of a filter is that of its "
        f"{measured['particles']['steps']} steps. There are {size(there['memory'])} of memory, "
        f"{size(there['disk'])} of disk and {there['files']:.2g} files free, and a day of every "
        f"core, {there['time'] / DAY:.0f} days:\n\n{table(header, rows)}"
    )


def size(number: float) -> str:
    """Of bytes, in the unit that suits."""
    scale, unit = next(
        pair
        for pair in ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"))
        if number >= pair[0] or pair[1] == "MB"
    )
    return f"{number / scale:.3g} {unit}"
