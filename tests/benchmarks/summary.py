"""Writes reports/benchmarks.md, tests/benchmarks/page.md with the measurements in
reports/benchmarks, and the times in README.md: ``python tests/benchmarks/summary.py``.
"""

import json
from collections.abc import Iterator
from pathlib import Path

from contests import CALLS, HERE, RESULTS, ROOT, SECONDS

import numpy as np  # isort: skip
import pandas as pd
from equal_bytes import CONTROL, OTHER

VECTORISED = 1.3  # least ratio of the kernel's time without vectorised loops to its own
SAME_QUALITY = 0.01  # greatest relative difference of a quality that counts as none
STARTS = {  # what, and its limit in s
    "imports_seconds": ("imports of models and filter, numba included", 1.0),
    "cached_seconds": ("first filters of three arms, machine code from the cache", 0.2),
    "compiled_seconds": ("first filters of three arms, everything compiled", 15.0),
}


def table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(
        f"| {' | '.join(cells)} |" for cells in [header, ["---"] * len(header), *rows]
    )


def verdict(met: bool) -> str:
    """The page's word on a limit."""
    return "met" if met else "**missed**"


def significant(value: float) -> str:
    """Two significant digits, all digits before the point kept."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """Three significant digits in the unit that suits."""
    for scale, unit in ((1, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * scale >= 1:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def times_an_item(benchmark: dict) -> np.ndarray:
    """Least time in s of each run for one of the items that a call treats."""
    return np.array(benchmark["least"]) / benchmark["extra_info"]["items"]


def contest_rows(benchmarks: list[dict]) -> Iterator[list[str]]:
    """Yield the cells of each row, contest by contest, the fastest opponent first."""
    for contest in sorted({benchmark["group"] for benchmark in benchmarks}):
        members = [b for b in benchmarks if b["group"] == contest]
        (ours,) = (b for b in members if b["extra_info"]["role"] == "ours")
        peers = [b for b in members if b["extra_info"]["role"] == "peer"]
        for peer in sorted(peers, key=lambda peer: np.median(times_an_item(peer))):
            yield [contest, *against(ours, peer)]


def against(ours: dict, peer: dict) -> list[str]:
    """Cells of the row of ``ours`` against one peer: name, ratio, target, verdict, quality."""
    stated = peer["extra_info"]
    here = times_an_item(ours)
    there = times_an_item(peer)
    ratios = there / here
    low, middle, high = (
        significant(value) for value in (ratios.min(), np.median(ratios), ratios.max())
    )
    times = f"{duration(np.median(here))} against {duration(np.median(there))}"
    ratio = f"{middle} ({low} to {high}) times as fast, {times}"

    quality, same = compared_quality(ours["extra_info"], stated)
    # speed at the cost of quality meets nothing
    met = int(np.sum(ratios >= stated["target"])) if same else 0
    result = verdict(met > 0)
    if 0 < met < len(ratios):
        result = f"**met in {met} of {len(ratios)} runs**"
    return [stated["against"], ratio, f"≥ {stated['target']}", result, quality]


def compared_quality(ours: dict, peer: dict) -> tuple[str, bool]:
    """The cell of the qualities of two members, and whether ours is as good."""
    for kind in ("error", "objective"):
        if kind in ours and kind in peer:
            value = ours[kind]
            rival = peer[kind]
            cell = f"{kind} {value:.4g} against {rival:.4g}"
            return cell, value <= rival + SAME_QUALITY * abs(rival)
    return "–", True


def contests(machine_info: dict, benchmarks: list[dict]) -> dict[str, object]:
    """Ratios to other libraries."""
    header = [
        "contest",
        "against",
        "ratio (range over the runs), times an item",
        "target",
        "",
        "quality (less is better)",
    ]
    configurations = {}
    for benchmark in benchmarks:
        stated = benchmark["extra_info"]
        if "configuration" in stated:
            configurations[f"- {stated['against']}: {stated['configuration']}"] = None
    versions = (f"{name} {number}" for name, number in machine_info["versions"].items())
    return {
        "machine": machine_info["machine"],
        "runs": len(benchmarks[0]["least"]),
        "contests": table(header, list(contest_rows(benchmarks))),
        "configurations": "\n".join(configurations),
        "versions": ", ".join(versions),
    }


def start(nanoseconds: dict, **measured: float) -> dict[str, str]:
    """First use, and the speed of a step of every law."""
    starts = []
    for key, (process, limit) in STARTS.items():
        met = verdict(measured[key] <= limit)
        starts.append([process, duration(measured[key]), f"≤ {limit:g} s", met])
    speeds = []
    for law, times in nanoseconds.items():
        ratio = times["scalar"] / times["kernel"]
        met = f"{ratio:.1f} times (≥ {VECTORISED:g}: {verdict(ratio >= VECTORISED)})"
        speeds.append([law, f"{times['kernel']:.0f}", f"{times['scalar']:.0f}", met])
    header = [
        "draws of a step, ns a particle",
        "kernel",
        "loops that are not vectorised",
        "vectorised, so many times as fast",
    ]
    return {
        "starts": table(["processor time", "", "limit", ""], starts),
        "speeds": table(header, speeds),
    }


def growth(file: Path) -> str:
    """Slopes of cost over size."""
    rows = []
    for measured in pd.read_csv(file).to_dict("records"):
        slope = measured["time_slope"]
        limit = measured["time_limit"]
        time = f"{slope:.2f}"
        memory = "–"
        if limit > 0:
            time += f" (≤ {limit:g}: {verdict(slope <= limit)})"
        if np.isfinite(measured["memory_slope"]):
            memory = f"{measured['memory_slope']:z.2f}"
        sizes = f"{measured['from']} to {measured['to']}"
        rows.append([measured["over"], sizes, time, memory])
    return table(["over", "sizes", "slope of time", "slope of memory"], rows)


def scale(machine: str, particles: dict, takes: dict) -> str:
    """Runs at scale."""
    few = takes["few"]
    many = takes["many"]
    return (
        f"**{particles['many']:,} particles**: {duration(particles['seconds_many'])} a particle "
        f"and step, {duration(particles['seconds_few'])} of {particles['few']:,}; "
        f"{particles['bytes_of_a_particle']:.0f} bytes a particle.\n\n"
        f"**{many['takes']:,} takes** drawn, fitted and filtered in blocks: "
        f"{duration(many['seconds'])} and {many['peak_bytes'] / 1e6:.0f} MB at the peak; "
        f"{few['takes']:,} takes {duration(few['seconds'])} and {few['peak_bytes'] / 1e6:.0f} MB "
        f"({machine})."
    )


def equal_bytes(machine: str, skipped: list[str], hashes: dict) -> dict[str, str]:
    """Bytes of results on other processors and threads."""
    reference, *settings = hashes
    rows = []
    for piece, expected in hashes[reference].items():
        cells = [piece]
        for setting in settings:
            equal = hashes[setting][piece] == expected
            differs = "other" if setting == CONTROL else "**other**"
            cells.append("equal" if equal else differs)
        rows.append(cells)
    return {
        "reference": reference,
        "bytes_machine": machine,
        "skipped": "; ".join(skipped) or "none",
        "equal_bytes": table(["piece", *settings], rows),
    }


def times_table(times: dict | None) -> str:
    """Times of the commands, and of the stages of `make repro`."""
    if times is None:
        return "Not measured: `make bench`."
    commands = {"make env": times["environment"], "make repro": times["repro"]}
    for dataset, smoke in times["smoke"].items():
        commands[f"make smoke DATASET={dataset}"] = smoke
    rows = []
    for command, spent in commands.items():
        seconds = f"{spent['seconds']:.0f}", f"{spent['processor_seconds']:.0f}"
        rows.append([f"`{command}`", *seconds])
    stages = []
    for stage, seconds in times["repro"]["stages"].items():
        stages.append([stage, f"{seconds:.1f}"])
    header = ["command", "wall clock, s", "processor time, s"]
    of_stages = table(["stage of `make repro`", "wall clock, s"], stages)
    return f"On {times['machine']}:\n\n{table(header, rows)}\n\n{of_stages}"


def times_sentence(times: dict | None) -> str:
    """Return the sentence of README.md on the time that its commands take."""
    if times is None:
        return "They take minutes: `make bench` measures them."
    environment = times["environment"]
    repro = times["repro"]
    smoke = []
    for dataset, spent in times["smoke"].items():
        smoke.append(f"{spent['processor_seconds']:.0f} s on {dataset}")
    return (
        f"On {times['machine']}: `make env` {environment['seconds']:.0f} s, `make repro` "
        f"{repro['seconds']:.0f} s, `make smoke` {' and '.join(smoke)} (processor time)."
    )


def with_times(readme: str, times: dict | None) -> str:
    """The text of README.md with its sentence on times."""
    begin = "<!-- times -->\n"
    end = "\n<!-- /times -->"
    before, _, rest = readme.partition(begin)
    _, _, after = rest.partition(end)
    return before + begin + times_sentence(times) + end + after


def measured_times(folder: Path) -> dict | None:
    """The measurements of times.py, None before the first."""
    file = folder / "times.json"
    return json.loads(file.read_text()) if file.is_file() else None


def page(folder: Path) -> str:
    """Text of reports/benchmarks.md from the files in ``folder``."""
    measured = {
        file.stem: json.loads(file.read_text()) for file in folder.glob("*.json")
    }
    fields = contests(**measured["contests"]) | start(**measured["start"])
    fields |= equal_bytes(**measured["equal_bytes"]) | {
        "growth": growth(folder / "growth.csv"),
    }
    fields["times"] = times_table(measured_times(folder))
    at_scale = "Not measured: `make bench-scale`."
    fields["scale"] = scale(**measured["scale"]) if "scale" in measured else at_scale
    fields |= {"CALLS": CALLS, "SECONDS": SECONDS, "OTHER": OTHER}
    return (HERE / "page.md").read_text().format(**fields)


if __name__ == "__main__":
    file = RESULTS.with_suffix(".md")
    readme = ROOT / "README.md"
    file.write_text(page(RESULTS))
    readme.write_text(with_times(readme.read_text(), measured_times(RESULTS)))
    print(f"bench: {file}, and the times in {readme}")
