"""Drawing of the stages of dvc.yaml in CONTRIBUTING.md.

``python tests/helpers/stage_drawing.py`` writes it.
"""

import re
from pathlib import Path

import networkx as nx
import yaml
from dvc.repo import Repo

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "CONTRIBUTING.md"
# the drawing is between these lines of the page
BLOCK = re.compile(r"(?<=<!-- stages -->\n).*?(?=<!-- /stages -->)", re.DOTALL)


def stage_arrows() -> list[tuple[str, str]]:
    """Return the arrows from a stage of the paper to those that read its outputs, in the order of
    dvc.yaml, without arrows from stages that another source has already read.
    """
    names = [*yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]]
    graph = nx.DiGraph()
    with Repo(ROOT) as repo:
        for reader, writer in repo.index.graph.edges:
            arrow = stage_name(writer.addressing), stage_name(reader.addressing)
            if set(arrow) <= set(names):  # not a stage of a dataset or of a study
                graph.add_edge(*arrow)

    arrows = nx.transitive_reduction(graph).edges
    return sorted(
        arrows,
        key=lambda arrow: (names.index(arrow[1]), names.index(arrow[0])),
    )


def stage_name(address: str) -> str:
    """Return the name of a stage without the item of its matrix."""
    return address.partition("@")[0]


def drawing() -> str:
    """Return a Mermaid flowchart of the stages."""
    lines = ["```mermaid", "flowchart LR"]
    lines += [f"  {writer} --> {reader}" for writer, reader in stage_arrows()]
    return "\n".join([*lines, "```", ""])


def expected_page(text: str) -> str:
    """Return the ``text`` of the page with the drawing of today's dvc.yaml."""
    return BLOCK.sub(lambda _: drawing(), text)


if __name__ == "__main__":
    PAGE.write_text(expected_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
