"""Drawing of the stages of dvc.yaml in CONTRIBUTING.md.

``python tests/helpers/stage_drawing.py`` writes it.
"""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "CONTRIBUTING.md"
# the drawing is between these lines of the page
BLOCK = re.compile(r"(?<=<!-- stages -->\n).*?(?=<!-- /stages -->)", re.DOTALL)
DATASET = "${dataset}"
PLACEHOLDER = re.compile(r"\$\{.*?\}")


def stage_graph(stages: dict[str, dict]) -> dict[str, list[str]]:
    """Return by stage the stages whose outputs it reads, in the order of ``stages``."""
    writers = {}
    for name, stage in stages.items():
        for output in stage.get("outs", []) + stage.get("metrics", []):
            writers[path_of(output)] = name
    graph = {}
    for name, stage in stages.items():
        inputs = stage.get("deps", []) + stage.get("params", [])
        read = {path_of(entry) for entry in inputs}
        sources = [writer for path, writer in writers.items() if overlaps(path, read)]
        graph[name] = list(
            dict.fromkeys(source for source in sources if source != name)
        )
    return graph


def path_of(entry: str | dict) -> str:
    """Return the path of an entry of ``deps`` or ``outs``, with * for the item of a matrix."""
    path = entry if isinstance(entry, str) else next(iter(entry))
    return PLACEHOLDER.sub("*", path.replace(DATASET, "DATASET"))


def overlaps(path: str, read: set[str]) -> bool:
    """Return whether ``path`` is in, or contains, one of the paths that are ``read``."""
    for other_path in read:
        shorter, longer = sorted((path, other_path), key=lambda text: text.count("/"))
        folders = zip(shorter.split("/"), longer.split("/"), strict=False)
        if all(same(*names) for names in folders):
            return True
    return False


def same(first: str, second: str) -> bool:
    """Return whether two names of folders can be the same after DVC has filled them in."""
    patterns = [re.escape(name).replace(r"\*", ".*") for name in (first, second)]
    return bool(re.fullmatch(patterns[0], second) or re.fullmatch(patterns[1], first))


def without_detours(graph: dict[str, list[str]]) -> dict[str, list[str]]:
    """Return ``graph`` without arrows from stages that another source has already read."""
    earlier: dict[str, set[str]] = {}
    for name, sources in graph.items():  # a stage stands after its sources
        earlier[name] = set(sources).union(*(earlier[source] for source in sources))
    kept_sources = {}
    for name, sources in graph.items():
        indirect = set().union(*(earlier[source] for source in sources))
        kept_sources[name] = [source for source in sources if source not in indirect]
    return kept_sources


def drawing(stages: dict[str, dict]) -> str:
    """Return a Mermaid flowchart of the stages."""
    lines = ["```mermaid", "flowchart LR"]
    graph = without_detours(stage_graph(stages))
    for name, sources in graph.items():
        lines += [f"  {source} --> {name}" for source in sources]
    return "\n".join([*lines, "```", ""])


def expected_page(text: str) -> str:
    """Return the ``text`` of the page with the drawing of today's dvc.yaml."""
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    return BLOCK.sub(lambda _: drawing(stages), text)


if __name__ == "__main__":
    PAGE.write_text(expected_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
