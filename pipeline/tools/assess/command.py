"""``python -m pipeline assess FILE [--model FILE]``: comparison of a new recording of the motion
with the recordings that a model was fitted to.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd
from jinja2 import Template

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import ConfigError, ModelDomainError, RecordingError
from pipeline.core.typed_yaml import read_yaml
from pipeline.models import load
from pipeline.models.closed_loop import MeanPath
from pipeline.models.exported.reader import ExportedErrors, ExportedModel
from pipeline.models.exported.writer import scores_by_horizon
from pipeline.models.joint_error.fit import runs_of
from pipeline.models.joint_error.samples import JointRun
from pipeline.models.model import Commands
from pipeline.perception.markers import follower
from pipeline.recordings.commands import commanded_steps
from pipeline.recordings.joint_logs import find_takes, read_dataset_movement
from pipeline.recordings.lags import in_phase, stretch
from pipeline.recordings.motion_capture import marker_rows
from pipeline.recordings.repetitions import SLACK
from pipeline.recordings.runs import joint_runs
from pipeline.recordings.steps import training_steps
from pipeline.statistics.scores import normal_log_score
from pipeline.tools.characterize.logs import folder_logs
from pipeline.tools.new_dataset.command import assigned_values, command_with

HERE, EXPORTS = Path(__file__).parent, Path("data/export")
CHARACTERIZED = Path(
    "data/characterize"
)  # runs of characterize, one folder per dataset
TAKE_TEXT, RUN_TEXT = (
    Template((HERE / f"{name}.txt").read_text(encoding="utf-8"), trim_blocks=True)
    for name in ("take", "run")
)
MOTION, TRACK = Path("data/ingest/motion"), Path("data/track")
FACTOR = 2.0  # greatest factor between predicted and measured standard deviation
ENOUGH = 20  # least number of test takes for a comparison without training takes
# false positive rate: half of it for the whole take, half for the greatest difference of a span
LEVEL = 0.05
MOST_CHANCE = (
    0.25  # greatest false positive rate; with a greater rate nothing can be shown
)
FEWEST = round(2 / MOST_CHANCE) - 1  # least number of takes to compare with
SPANS = 10  # number of parts of the motion that are compared


def run(file: Path, model: Path | None = None, set: Sequence[str] = ()) -> None:
    """Predict each take in the recording by the exported model and print the verdict."""
    if model is None:
        name = config.sections("assess", HERE / "reads.yaml").dataset.name
        files = sorted(EXPORTS.glob(f"{name}_*.json"))
        if len(files) != 1:
            present = ", ".join(map(str, files)) or f"none of {name} in {EXPORTS}"
            message = f"name one exported model by --model; there is {present}; "
            message += "`python -m pipeline export MODEL` writes one"
            raise ConfigError(message, key="--model")
        model = files[0]
    law, file = load(model), file.resolve()
    if isinstance(law, ExportedErrors):
        runs = _runs_in(file, law, model, assigned_values(set))
        for text in assessments_of_runs(runs, law, model.name):
            print(text)
        return
    with chdir(run_folder(law.record["dataset"], model)):
        for text in _assessments(file, law, model.name):
            print(text)


def _runs_in(
    file: Path, model: ExportedErrors, export: Path, assigned: Mapping[str, str]
) -> list[JointRun]:
    """Return the runs in joint logs, read with the ``assigned`` values as by characterize, or the
    takes of the model's dataset in another ``file``; print what is not used.
    """
    logs = folder_logs(file.parent, assigned, only=file)
    joints = [*model.law.joints]
    if logs.movements:
        names = [*next(iter(logs.movements.values())).joints]
        if missing := [joint for joint in joints if joint not in names]:
            message = (
                f"the log has no joint {', '.join(missing)}; it has {', '.join(names)}"
            )
            raise RecordingError(message, file=file)
        found = joint_runs(logs.movements, logs.rate, joints)
        for name, reason in (logs.unused | found.unused).items():
            print(f"assess: not used: {name}: {reason}")
        if standing := [joint for joint in joints if joint in found.unused]:
            reason = found.unused[standing[0]]
            message = f"{', '.join(standing)} of the model stands still: {reason}"
            raise RecordingError(message, file=file)
        return found.runs
    with chdir(run_folder(model.record["dataset"], export)):
        dataset = config.sections("assess", HERE / "reads.yaml").dataset
        if dataset.mocap is None:
            reason = next(iter(logs.unused.values()), "no log of joints")
            message = f"no measured and commanded joint angles: {reason}"
            if logs.missing:
                words = f"assess {file} --model {export}"
                command = command_with(words, {**assigned, **logs.missing})
                message += f"; correct the values and run `{command}`"
            raise RecordingError(message, file=file)
        first = runs_of(training_steps(dataset.robot, dataset.motion))[0]
        takes = new_takes(file, dataset, first.command)
    return [replace(first, name=name, measured=q) for name, q in takes.items()]


def assessments_of_runs(
    runs: Iterable[JointRun], model: ExportedErrors, export: str
) -> Iterator[str]:
    """Yield the verdict on each of ``runs`` by a joint error law: predicted over measured standard
    deviation and coverage at three horizons, and the rank of its log score among the runs of the
    fit, which stand in the exported file.
    """
    known = model.record["runs"]
    for run in runs:
        model.require_period(1 / run.rate)
        scores, all_rows = scores_by_horizon(model.law, run)
        rows = {}
        for horizon, score in scores.items():
            own = all_rows[all_rows["horizon"] == horizon]
            share = own["predicted_rad"] / own["measured_rad"]
            inside = np.average(own["one_sigma"], weights=own["count"])
            others = np.array(
                [one["scores"][horizon] for one in known if horizon in one["scores"]]
            )
            count = 1 + len(others)
            lower = (1 + np.sum(others <= score)) / count
            rows[horizon] = share.min(), share.max(), inside, score, lower, count
        if not rows:
            yield f"assess: {run.name}: no joint is commanded to move; nothing can be compared"
            continue
        columns = ["low", "high", "inside", "score", "lower", "count"]
        table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
        yield RUN_TEXT.render(
            run=run, rows=table, known=len(known), export=export, factor=FACTOR
        )


def run_folder(dataset: str, model: Path) -> Path:
    """Return the folder in which the stages ran on ``dataset``: the project's root or the folder of
    characterize. Raises ConfigError without such a run.
    """
    for folder in (Path(), CHARACTERIZED / dataset):
        composed = folder / config.COMPOSED
        if composed.is_file() and read_yaml(composed)["dataset"]["name"] == dataset:
            return folder
    message = (
        f"the model is of the dataset {dataset}, which has no run here; set dataset: "
    )
    message += f"{dataset} in params.yaml and run `dvc repro`, or run characterize"
    raise ConfigError(message, file=model)


def _assessments(file: Path, law: ExportedModel, export: str) -> Iterator[str]:
    """Yield the verdict on each take in the recording."""
    dataset = config.sections("assess", HERE / "reads.yaml").dataset
    names, q = contracts.stacked(joints := contracts.read("joints", TRACK), "q")
    fitted = (joints.drop_duplicates("take")["part"] == "training").to_numpy()
    reference = ~fitted if np.sum(~fitted) >= ENOUGH else np.ones_like(fitted)
    known, mean, rate = (
        np.array(names)[reference],
        q[fitted].mean(axis=0),
        dataset.motion.rate,
    )
    takes = new_takes(file, dataset, mean)
    poses = np.concatenate([q[reference], [*takes.values()]])
    path, share = MeanPath(law.chain, mean), law.record["closed_loop_share"]
    steps = commanded_steps(contracts.read("trajectory", MOTION), rate)
    commands = path.commands(share) if share > 0 else Commands(steps, path.path, 0.0)
    innovations = innovations_of(law, commands, poses)
    for number, name in enumerate(takes, len(known)):
        # a take of the dataset is compared with the others
        others = np.pad(known != name, (0, len(takes)))
        verdict = judge(*innovations, number, others, dataset.robot.joints, rate)
        among = int(np.sum(fitted[reference] & (known != name)))
        yield assessment(name, export, among, verdict)


def new_takes(
    file: Path, dataset: SimpleNamespace, mean: np.ndarray
) -> dict[str, np.ndarray]:
    """Return name → angles (M+1, n) in rad of the repetitions in ``file``: one in a motion capture
    take, all in a joint log. Repetitions in a log are shifted into phase with ``mean`` (M+1, n) in
    rad, the mean of the dataset's takes.

    Raises RecordingError as the stages of the dataset do.
    """
    if not file.exists():
        raise RecordingError("there is no such file", file=file)
    if dataset.mocap is not None:
        rows, _ = marker_rows(file.stem, file, "test", dataset)
        return {
            file.stem: follower(dataset.robot, dataset.mocap)(rows, take=file.stem).q
        }
    options, steps = dataset.joint_log, dataset.motion.steps
    moving, rest = steps - 2 * options.rest, options.rest
    movement = file.name if file.is_dir() else file.stem
    read = {movement: read_dataset_movement(movement, file, dataset)}
    takes, observed, _ = find_takes(read, dataset)
    if not takes:
        motions = "; ".join(sorted(set(observed))) or "no motion"
        message = f"no repetition of the dataset's motion; the file has {motions}"
        raise RecordingError(message, file=file)
    path, near = mean[rest : rest + moving + 1], (SLACK, rest > 0)
    return {
        name: stretch(
            take.actual,
            in_phase(take.actual, take.first, path, *near) - rest,
            steps + 1,
        )
        for name, take in takes.items()
    }


def innovations_of(
    model: ExportedModel, commands: Commands, poses: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the innovations e (T, M, n) of the measured ``poses`` y (T, M+1, n), in rad, under
    the ``commands``, each one step after the last measured pose, and their covariance S in rad²:

        e = y_{k+1} − E(q_{k+1} | y_k),   S = Cov(q_{k+1} | y_k) + 2Σ.

    The covariance Σ of a measured pose is exported with the model, or zero if unknown. Raises
    ModelDomainError where the model has no moments, or no noise at a pose.
    """
    known, before = model.record["pose_covariance_rad2"], poses[:, :-1]
    v = model.command(before, commands.path[: before.shape[1]], task_step=commands.v)
    error = poses[:, 1:] - model.mean(before, task_step=v)
    S = model.covariance(before, task_step=v) + (
        0.0 if known is None else 2 * np.array(known)
    )
    if not np.all(np.linalg.eigvalsh(S)[..., 0] > 0):
        message = "the model has no noise at a pose, so no measurement can be compared with it;"
        advice = "set dataset.motion.pose_noise and export the model again"
        raise ModelDomainError(f"{message} {advice}")
    return error, S


class TakeVerdict(NamedTuple):
    """Distance of a take from N other takes, for all joints together and for each joint."""

    evidence: (
        pd.DataFrame
    )  # all joints, then each joint: own, mean, std (nats per step) and p
    p_whole: float  # p of the greatest |t| of the whole take
    ends: np.ndarray  # (SPANS + 1,) s, limits of the spans
    span_t: np.ndarray  # (n, SPANS) t by joint and span
    p_spans: float  # p of the greatest |t| in ``span_t``
    count: int  # N

    @property
    def limit(self) -> float:
        """Greatest p of a take that is called different; with few takes the least possible p."""
        return max(LEVEL / 2, 1 / (1 + self.count))

    @property
    def behaves(self) -> bool:
        """True if neither the whole take nor a span differs from the other takes."""
        return bool(min(self.p_whole, self.p_spans) > self.limit)

    @property
    def shows(self) -> bool:
        """True if there are enough takes to show a difference."""
        return bool(2 * self.limit <= MOST_CHANCE)


def judge(
    error: np.ndarray,
    covariance: np.ndarray,
    number: int,
    others: np.ndarray,
    joints: Sequence[str],
    rate: float,
) -> TakeVerdict:
    """Return the verdict on take ``number`` of T takes of n ``joints``, compared with the takes in
    the mask ``others`` (T,); ``rate`` in Hz.

    The evidence x of a take is the mean of ln N(e; 0, S) over its steps. The distance from N other
    takes is t = (x − x̄)/(s√(1 + 1/N)). Log evidence is skewed and heavy-tailed, so that t has no
    Student law. Instead, t is also computed for every other take among the remaining takes, and p
    is the rank of the greatest |t|, exact for exchangeable takes (Vovk et al., Algorithmic Learning
    in a Random World, 2005).
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    alone = -0.5 * ((error / std) ** 2 + np.log(2 * np.pi)) - np.log(std)
    together = normal_log_score(error, covariance)
    evidence = np.concatenate([together[..., None], alone], axis=-1)  # (T, M, 1 + n)
    whole = evidence.mean(axis=1)
    steps = np.array_split(np.arange(evidence.shape[1]), SPANS)
    spans = np.stack([evidence[:, part, 1:].mean(axis=1) for part in steps], axis=-1)
    _, p_whole, p = _distances(whole[number], whole[others])
    span_t, p_spans, _ = _distances(spans[number], spans[others])
    table = {"own": whole[number], "mean": whole[others].mean(axis=0)}
    table |= {"std": whole[others].std(axis=0, ddof=1), "p": p}
    table = pd.DataFrame(table, index=["all joints", *joints])
    ends = np.array([0, *(part[-1] + 1 for part in steps)]) / rate
    return TakeVerdict(table, p_whole, ends, span_t, p_spans, int(others.sum()))


def _distances(
    own: np.ndarray, theirs: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Return t (...) of ``own`` (...) from N takes ``theirs`` (N, ...); p of the greatest |t| by
    its rank among the greatest of the N takes; and p of each |t| alone.
    """

    def distance(one: np.ndarray, rest: np.ndarray) -> np.ndarray:
        scale = rest.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(rest))
        return (one - rest.mean(axis=0)) / scale

    t, count = distance(own, theirs), len(theirs)
    others = [np.delete(theirs, i, axis=0) for i in range(count)]
    sizes = np.abs(np.stack(list(map(distance, theirs, others))))
    greatest = sizes.reshape(count, -1).max(axis=1)
    p = (1 + np.sum(greatest >= np.abs(t).max())) / (1 + count)
    return t, float(p), (1 + np.sum(sizes >= np.abs(t), axis=0)) / (1 + count)


def assessment(take: str, model: str, fitted: int, verdict: TakeVerdict) -> str:
    """Return the verdict as a sentence, and one line of numbers per joint. ``fitted`` is the number
    of takes to compare with to which the ``model`` was fitted.
    """
    joint, span = np.unravel_index(
        np.argmax(np.abs(verdict.span_t)), verdict.span_t.shape
    )
    begins, ends = verdict.ends[span : span + 2]
    values = {
        "joint": verdict.evidence.index[1 + joint],
        "t": verdict.span_t[joint, span],
    }
    values |= {"begins": begins, "ends": ends, "fewest": FEWEST, "fitted": fitted}
    return TAKE_TEXT.render(take=take, model=model, v=verdict, **values)
