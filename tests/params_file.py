"""A params.yaml for tests, of which they change some lines."""

from __future__ import annotations

from pathlib import Path

CHOICES = {
    "dataset": "youbot",
    "models": "[additive, wishart, gaussian]",
    "filter": "systematic",
    "articulation": "least_squares",
    "simulation": "one_step",
    "wrench": "paper",
    "scale": "paper",
    "compute": "local",
    "seed": "2017",
    "overrides": "{}",
}


def parameters(folder: Path, comment: str = "", **choices: str | None) -> Path:
    """params.yaml in ``folder`` with some of its lines changed, or left out where the choice is
    None.
    """
    file = folder / "params.yaml"
    lines = [
        f"{key}: {value} {comment}"
        for key, value in (CHOICES | choices).items()
        if value is not None
    ]
    file.write_text("\n".join(lines) + "\n")
    return file
