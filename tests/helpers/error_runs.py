"""Runs of joints whose errors follow a known joint error law."""

import numpy as np

from pipeline.models.joint_error.drive import GROWTH, INPUTS
from pipeline.models.joint_error.law import JointErrorModel
from pipeline.models.joint_error.samples import JointRun

RATE = 100.0
JOINTS = ("a", "b")
# φ, ψ, χ: a fast part of 3 samples and a slow one; b persists with a little pull
MEMORY = np.array([[1.2, -0.45, 0.2], [0.9, 0.0, 0.05]])


def known_law(**changes) -> JointErrorModel:
    """A law of two joints with memory, a mean that depends on speed and sign, normal noise."""
    gain = np.zeros((2, len(INPUTS)))
    gain[:, INPUTS.index("speed")] = [2e-3, -1e-3]
    gain[:, INPUTS.index("sign")] = [3e-4, 2e-4]
    scale = np.zeros((2, len(GROWTH)))
    scale[:, GROWTH.index("rest")] = [1e-10, 1e-10]
    scale[:, GROWTH.index("growth")] = [1e-8, 4e-8]
    values = {
        "joints": JOINTS,
        "rate": RATE,
        "memory": MEMORY,
        "mean_gain": gain,
        "scale": scale,
        "drift": np.zeros(2),
        "degrees": np.full(2, np.inf),
        "reach": np.full(2, 1.0),
        "quantum": np.zeros(2),
        "jump": np.full(2, 5.0),
        "lag": np.zeros(2),
        "lag_std": np.zeros(2),
    }
    return JointErrorModel(**values | changes)


def persistent_law(**changes) -> JointErrorModel:
    """The law without memory: white steps of constant variance."""
    scale = np.zeros((2, len(GROWTH)))
    scale[:, 0] = [1e-8, 4e-8]
    empty = {"mean_gain": np.zeros((2, len(INPUTS))), "scale": scale}
    return known_law(memory=np.tile([1.0, 0.0, 0.0], (2, 1)), **empty | changes)


def sweep(number: int, samples: int = 600) -> np.ndarray:
    """(samples, 2) commanded angles in rad of the motion ``number``, at rest at both ends."""
    share = np.clip((np.arange(samples) - 20) / (samples - 40), 0, 1)[:, None]
    turns = np.array([1.0 + 0.37 * (number % 5), 2.0 + 0.23 * number])
    return 0.3 * np.sin(2 * np.pi * share * turns) * np.sin(np.pi * share) ** 2


def runs_of_law(
    law: JointErrorModel,
    rng: np.random.Generator,
    motions: int = 4,
    repeats: int = 2,
) -> list[JointRun]:
    """Simulate ``repeats`` runs of each of several motions under ``law``."""
    runs = []
    zero = np.zeros(len(law.joints))
    for number in range(motions):
        command = sweep(number)
        steps = np.diff(command, axis=0)
        q = np.tile(command[0], (repeats, 1))
        memory = law.first_memory(q, command[0], rng)
        path = [q]
        for step in steps:
            q, memory = law.follow(q, step, memory, rng)
            path.append(q)
        for take, measured in enumerate(np.stack(path, axis=1)):
            run = JointRun(
                f"{number}.{take}",
                law.rate,
                command,
                measured,
                law.joints,
                lag=zero,
                quantum=zero,
                pose_noise=None,
                motion=str(number),
            )
            runs.append(run)
    return runs


def jumping_runs(rng, motions: int = 4, repeats: int = 2) -> list[JointRun]:
    """Runs of two joints whose speed jumps: each error rings down after a jump, Δc·τ·e^(−t/τ), and
    has white noise of 50 µrad.
    """
    runs = []
    samples = 600
    fade = np.exp(-1 / (RATE * 0.06))
    for motion in range(motions):
        speed = np.zeros((samples, 2))
        for number in range(6):
            first = 30 + 90 * number
            speed[first : first + 60] = rng.uniform(0.2, 0.8, 2) * (-1) ** number
        command = np.cumsum(speed, axis=0) / RATE
        change = np.diff(speed, axis=0, prepend=0.0)
        error = np.zeros((samples, 2))
        for k in range(1, samples):
            error[k] = fade * error[k - 1] - 0.02 * change[k]
        for repeat in range(repeats):
            noise = 5e-5 * rng.standard_normal(error.shape)
            run = JointRun(
                name=f"{motion}.{repeat}",
                rate=RATE,
                command=command,
                measured=command + error + noise,
                joints=("a", "b"),
                lag=np.zeros(2),
                quantum=np.zeros(2),
                pose_noise=None,
                motion=str(motion),
            )
            runs.append(run)
    return runs
