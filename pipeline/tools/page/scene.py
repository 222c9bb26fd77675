"""An arm in space to look at: its joints' origins as a skeleton, and what models say of its tip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.arm.description import describe
from pipeline.arm.model import link_chains
from pipeline.core.options.dataset import Robot
from pipeline.tools.page.posterior import Posterior

PATH = 100  # places of the tip's path that are drawn
SHOWN = 0.25  # of the arm's size, the greatest standard deviation of the tip as it is drawn


@dataclass(frozen=True)
class Scene:
    """An arm over K poses, shown at F of them, in the axes of its base.

    ``nodes`` (F, L, 3) m: its base, the origins of its joints and its tip; ``path`` (K, 3) m of the
    tip. By model ``deviations`` (F, 3) m, where it has the tip's mean beside the measured tip, and
    ``covariances`` (F, 3, 3) m² of the tip's position.
    """

    nodes: np.ndarray
    path: np.ndarray
    deviations: Mapping[str, np.ndarray]
    covariances: Mapping[str, np.ndarray]

    @property
    def centre(self) -> np.ndarray:
        """(3,) m, of a box round all that is shown."""
        places = np.concatenate([self.nodes.reshape(-1, 3), self.path])
        return (places.min(axis=0) + places.max(axis=0)) / 2

    @property
    def radius(self) -> float:
        """m, of a sphere round the centre that holds all that is shown."""
        places = np.concatenate([self.nodes.reshape(-1, 3), self.path])
        return float(np.linalg.norm(places - self.centre, axis=-1).max())

    @property
    def magnification(self) -> int:
        """A round number by which deviations and standard deviations are drawn larger, so that the
        greatest is :data:`SHOWN` of the radius at most; 1 at least.
        """
        greatest = max(
            (np.sqrt(np.linalg.eigvalsh(each)[:, -1].max()) for each in self.covariances.values()),
            default=0.0,
        )
        if not greatest > 0:
            return 1
        wanted = max(SHOWN * self.radius / greatest, 1.0)
        power = 10 ** int(np.log10(wanted))
        return max(step * power for step in (1, 2, 5) if step * power <= wanted)


def scene_of(
    robot: Robot, truth: np.ndarray, posteriors: Mapping[str, Posterior], rows: np.ndarray
) -> Scene:
    """The ``robot`` at the poses ``truth`` (K, n) in rad, shown at the numbers ``rows`` (F,) of
    them; what models say of the joints reaches the tip by its Jacobian J: J·Cov·Jᵀ.
    """
    described = describe(robot)
    links = [joint.child for joint in described.joints]
    chains = link_chains(robot, dict.fromkeys([*links, described.tip]), "robot.joints")
    # the joints that move a link are the first ones of the arm
    places = {
        link: chain.pose(truth[:, : len(chain.lower)])[:, :3] for link, chain in chains.items()
    }
    path = places[described.tip]
    skeleton = [np.zeros_like(path), *(places[link] for link in links), path]
    shown = truth[rows]
    jacobian = chains[described.tip].jacobian(shown)[:, :3]
    deviations, covariances = {}, {}
    for model, posterior in posteriors.items():
        deviations[model] = np.matvec(jacobian, posterior.mean[rows] - shown)
        covariances[model] = jacobian @ posterior.covariance[rows] @ np.swapaxes(jacobian, -1, -2)
    return Scene(np.stack(skeleton, axis=1)[rows], path, deviations, covariances)


def scene_data(scene: Scene) -> dict:
    """What the page's script has to know of ``scene`` at every frame, in m."""
    return {
        "centre": _rounded(scene.centre),
        "radius": round(scene.radius, 4),
        "path": [_rounded(place) for place in scene.path[:: max(len(scene.path) // PATH, 1)]],
        "times": scene.magnification,
    }


def scene_frame(scene: Scene, frame: int) -> dict:
    """What it has to know of a ``frame``: the skeleton in m, and by model the place (m) and the
    covariance (m², upper triangle row by row) of the tip as they are drawn.
    """
    tip, times, upper = scene.nodes[frame, -1], scene.magnification, np.triu_indices(3)
    return {
        "nodes": [_rounded(node) for node in scene.nodes[frame]],
        "tips": {
            model: {
                "place": _rounded(tip + times * scene.deviations[model][frame]),
                "covariance": [float(f"{x:.4g}") for x in times**2 * covariance[frame][upper]],
            }
            for model, covariance in scene.covariances.items()
        },
    }


def _rounded(place: np.ndarray) -> list[float]:
    return np.round(place, 4).tolist()
