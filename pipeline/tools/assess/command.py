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
from jinja2 import Environment, FileSystemLoader

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
from pipeline.tools.characterize.logs import FolderLogs, folder_logs
from pipeline.tools.new_dataset.command import assigned_values, command_with

HERE = Path(__file__).parent
EXPORTS = Path("data/export")
CHARACTERIZED = Path("data/characterize")  # runs of characterize, a folder per dataset
TEXTS = Environment(loader=FileSystemLoader(HERE), trim_blocks=True)
TAKE_TEXT = TEXTS.get_template("take.txt")
RUN_TEXT = TEXTS.get_template("run.txt")
MOTION = Path("data/ingest/motion")
TRACK = Path("data/track")
FACTOR = 2.0  # greatest factor between predicted and measured standard deviation
ENOUGH = 20  # least number of test takes for a comparison without training takes
# false positive rate: half of it for the whole take, half for the greatest difference of a span
LEVEL = 0.05
# greatest false positive rate; with a greater one nothing can be shown
MOST_CHANCE = 0.25
FEWEST = round(2 / MOST_CHANCE) - 1  # least number of takes to compare with
SPANS = 10  # number of parts of the motion that are compared


def run(file: Path, model: Path | None = None, set: Sequence[str] = ()) -> None:
    """Predict each take in the recording by the exported model and print the verdict."""
    export = model or _only_export()
    law = load(export)
    file = file.resolve()
    if isinstance(law, ExportedErrors):
        runs = _runs_in(file, law, export, assigned_values(set))
        for text in assessments_of_runs(runs, law, export.name):
            print(text)
        return
    with chdir(run_folder(law.record["dataset"], export)):
        for text in _assessments(file, law, export.name):
            print(text)


def _only_export() -> Path:
    """Return the exported model of params.yaml's dataset; ConfigError unless there is one."""
    name = config.sections("assess", HERE / "reads.yaml").dataset.name
    files = sorted(EXPORTS.glob(f"{name}_*.json"))
    if len(files) != 1:
        present = ", ".join(map(str, files)) or f"none of {name} in {EXPORTS}"
        raise ConfigError(
            f"name one exported model by --model; there is {present}; "
            "`python -m pipeline export MODEL` writes one",
            key="--model",
        )
    return files[0]


def _runs_in(
    file: Path,
    model: ExportedErrors,
    export: Path,
    assigned: Mapping[str, str],
) -> list[JointRun]:
    """Return the runs in joint logs, read with the ``assigned`` values as by characterize, or the
    takes of the model's dataset in another ``file``; print what is not used.
    """
    logs = folder_logs(file.parent, assigned, only=file)
    if logs.movements:
        return _runs_of_logs(logs, list(model.law.joints), file)
    with chdir(run_folder(model.record["dataset"], export)):
        dataset = config.sections("assess", HERE / "reads.yaml").dataset
        if dataset.mocap is None:
            reason = next(iter(logs.unused.values()), "no log of joints")
            advice = ""
            if logs.missing:
                words = f"assess {file} --model {export}"
                command = command_with(words, {**assigned, **logs.missing})
                advice = f"; correct the values and run `{command}`"
            raise RecordingError(
                f"no measured and commanded joint angles: {reason}{advice}",
                file=file,
            )
        first = runs_of(training_steps(dataset.robot, dataset.motion))[0]
        takes = new_takes(file, dataset, first.command)
    return [replace(first, name=name, measured=q) for name, q in takes.items()]


def _runs_of_logs(
    logs: FolderLogs,
    joints: Sequence[str],
    file: Path,
) -> list[JointRun]:
    """Return the runs of the model's ``joints`` in ``logs``; print what is not used."""
    logged = next(iter(logs.movements.values())).joints
    if missing := [joint for joint in joints if joint not in logged]:
        raise RecordingError(
            f"the log has no joint {', '.join(missing)}; it has {', '.join(logged)}",
            file=file,
        )
    runs, unused = joint_runs(logs.movements, logs.rate, joints)
    for name, reason in (logs.unused | unused).items():
        print(f"assess: not used: {name}: {reason}")
    if standing := [joint for joint in joints if joint in unused]:
        reason = unused[standing[0]]
        raise RecordingError(
            f"{', '.join(standing)} of the model stands still: {reason}",
            file=file,
        )
    return runs


class HorizonVerdict(NamedTuple):
    """Predictions of a run at one horizon."""

    low: float  # least and greatest predicted over measured standard deviation of a joint
    high: float
    inside: float  # share of the errors within one standard deviation
    score: float  # nats a joint and sample
    lower: float  # share of the ``count`` runs with a score that is not higher
    count: int  # runs of the fit and this one


def assessments_of_runs(
    runs: Iterable[JointRun],
    model: ExportedErrors,
    export: str,
) -> Iterator[str]:
    """Yield the verdict on each of ``runs`` by a joint error law: predicted over measured standard
    deviation and coverage at three horizons, and the rank of its log score among the runs of the
    fit, which stand in the exported file.
    """
    fitted = model.record["runs"]
    for run in runs:
        model.require_period(1 / run.rate)
        scores, rows = scores_by_horizon(model.law, run)
        verdicts = {}
        for horizon, score in scores.items():
            at_horizon = rows[rows["horizon"] == horizon]
            ratio = at_horizon["predicted_rad"] / at_horizon["measured_rad"]
            of_fit = [record["scores"].get(horizon) for record in fitted]
            of_fit = np.array([value for value in of_fit if value is not None])
            count = 1 + len(of_fit)
            verdicts[horizon] = HorizonVerdict(
                low=ratio.min(),
                high=ratio.max(),
                inside=np.average(at_horizon["one_sigma"], weights=at_horizon["count"]),
                score=score,
                lower=(1 + np.sum(of_fit <= score)) / count,
                count=count,
            )
        if not verdicts:
            yield f"assess: {run.name}: no joint is commanded to move; nothing can be compared"
            continue
        lows = [verdict.low for verdict in verdicts.values()]
        highs = [verdict.high for verdict in verdicts.values()]
        behaves = min(lows) >= 1 / FACTOR and max(highs) <= FACTOR
        yield RUN_TEXT.render(
            run=run,
            behaves=behaves,
            verdicts=verdicts,
            fitted=len(fitted),
            export=export,
            factor=FACTOR,
        )


def run_folder(dataset: str, model: Path) -> Path:
    """Return the folder in which the stages ran on ``dataset``: the project's root or the folder of
    characterize. Raises ConfigError without such a run.
    """
    for folder in (Path(), CHARACTERIZED / dataset):
        composed = folder / config.COMPOSED
        if composed.is_file() and read_yaml(composed)["dataset"]["name"] == dataset:
            return folder
    raise ConfigError(
        f"the model is of the dataset {dataset}, which has no run here; set dataset: "
        f"{dataset} in params.yaml and run `dvc repro`, or run characterize",
        file=model,
    )


def _assessments(file: Path, law: ExportedModel, export: str) -> Iterator[str]:
    """Yield the verdict on each take in the recording."""
    dataset = config.sections("assess", HERE / "reads.yaml").dataset
    joints = contracts.read("joints", TRACK)
    names, q = contracts.stacked(joints, "q")
    fitted = (joints.drop_duplicates("take")["part"] == "training").to_numpy()
    reference = np.ones_like(fitted)
    if np.sum(~fitted) >= ENOUGH:
        reference = ~fitted
    names = np.array(names)[reference]
    fitted_names = fitted[reference]
    mean = q[fitted].mean(axis=0)
    rate = dataset.motion.rate
    takes = new_takes(file, dataset, mean)

    share = law.record["closed_loop_share"]
    path = MeanPath(law.chain, mean)
    if share > 0:
        commands = path.commands(share)
    else:
        steps = commanded_steps(contracts.read("trajectory", MOTION), rate)
        commands = Commands(steps, path.path, 0.0)
    poses = np.concatenate([q[reference], [*takes.values()]])
    error, covariance = innovations_of(law, commands, poses)
    for number, name in enumerate(takes, len(names)):
        # a take of the dataset is compared with the others
        compared = np.pad(names != name, (0, len(takes)))
        verdict = judge(error, covariance, number, compared, dataset.robot.joints, rate)
        compared_and_fitted = int(np.sum(fitted_names & (names != name)))
        yield assessment(name, export, compared_and_fitted, verdict)


def new_takes(
    file: Path,
    dataset: SimpleNamespace,
    mean: np.ndarray,
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
        track = follower(dataset.robot, dataset.mocap)
        return {file.stem: track(rows, take=file.stem).q}
    steps = dataset.motion.steps
    rest = dataset.joint_log.rest
    movement = file.name if file.is_dir() else file.stem
    log = read_dataset_movement(movement, file, dataset)
    repetitions, observed, _ = find_takes({movement: log}, dataset)
    if not repetitions:
        motions = "; ".join(sorted(set(observed))) or "no motion"
        message = f"no repetition of the dataset's motion; the file has {motions}"
        raise RecordingError(message, file=file)
    path = mean[rest : steps - rest + 1]
    takes = {}
    for name, take in repetitions.items():
        first = in_phase(take.actual, take.first, path, SLACK, rest > 0)
        takes[name] = stretch(take.actual, first - rest, steps + 1)
    return takes


def innovations_of(
    model: ExportedModel,
    commands: Commands,
    poses: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the innovations e (T, M, n) of the measured ``poses`` y (T, M+1, n), in rad, under
    the ``commands``, each one step after the last measured pose, and their covariance S in rad²:

        e = y_{k+1} − E(q_{k+1} | y_k),   S = Cov(q_{k+1} | y_k) + 2Σ.

    The covariance Σ of a measured pose is exported with the model, or zero if unknown. Raises
    ModelDomainError where the model has no moments, or no noise at a pose.
    """
    before = poses[:, :-1]
    v = model.command(before, commands.path[: before.shape[1]], task_step=commands.v)
    error = poses[:, 1:] - model.mean(before, task_step=v)
    S = model.covariance(before, task_step=v)
    measured = model.record["pose_covariance_rad2"]
    if measured is not None:
        S = S + 2 * np.array(measured)
    if not np.all(np.linalg.eigvalsh(S)[..., 0] > 0):
        raise ModelDomainError(
            "the model has no noise at a pose, so no measurement can be compared with it; "
            "set dataset.motion.pose_noise and export the model again",
        )
    return error, S


class TakeVerdict(NamedTuple):
    """Distance of a take from N other takes, for all joints together and for each joint."""

    # all joints, then each joint: own, mean, std (nats per step), p
    evidence: pd.DataFrame
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
    compared: np.ndarray,
    joints: Sequence[str],
    rate: float,
) -> TakeVerdict:
    """Return the verdict on take ``number`` of T takes of n ``joints``, compared with the takes in
    the mask ``compared`` (T,); ``rate`` in Hz.

    The evidence x of a take is the mean of ln N(e; 0, S) over its steps. The distance from N other
    takes is t = (x − x̄)/(s√(1 + 1/N)). Log evidence is skewed and heavy-tailed, so that t has no
    Student law. Instead, t is also computed for every other take among the remaining takes, and p
    is the rank of the greatest |t|, exact for exchangeable takes (Vovk et al., Algorithmic Learning
    in a Random World, 2005).
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    by_joint = -0.5 * ((error / std) ** 2 + np.log(2 * np.pi)) - np.log(std)
    together = normal_log_score(error, covariance)
    evidence = np.concatenate([together[..., None], by_joint], axis=-1)  # (T, M, 1 + n)
    whole = evidence.mean(axis=1)
    spans = np.array_split(np.arange(evidence.shape[1]), SPANS)
    means = [evidence[:, steps, 1:].mean(axis=1) for steps in spans]
    by_span = np.stack(means, axis=-1)
    of_whole = _distances(whole[number], whole[compared])
    of_spans = _distances(by_span[number], by_span[compared])
    columns = {
        "own": whole[number],
        "mean": whole[compared].mean(axis=0),
        "std": whole[compared].std(axis=0, ddof=1),
        "p": of_whole.p,
    }
    ends = [0, *(steps[-1] + 1 for steps in spans)]
    return TakeVerdict(
        evidence=pd.DataFrame(columns, index=["all joints", *joints]),
        p_whole=of_whole.p_greatest,
        ends=np.array(ends) / rate,
        span_t=of_spans.t,
        p_spans=of_spans.p_greatest,
        count=int(compared.sum()),
    )


class Distances(NamedTuple):
    """Distances t of the numbers of a take from those of N other takes."""

    t: np.ndarray  # (...)
    p_greatest: float  # rank of the greatest |t| among the greatest of the N takes
    p: np.ndarray  # (...) rank of each |t|


def _distances(take: np.ndarray, references: np.ndarray) -> Distances:
    """Return the distances of ``take`` (...) from the ``references`` (N, ...)."""
    count = len(references)
    t = _distance(take, references)
    sizes = np.empty_like(references)  # |t| of each reference from the rest
    for number, reference in enumerate(references):
        rest = np.delete(references, number, axis=0)
        sizes[number] = np.abs(_distance(reference, rest))
    greatest = sizes.reshape(count, -1).max(axis=1)
    farther = np.sum(greatest >= np.abs(t).max())
    farther_each = np.sum(sizes >= np.abs(t), axis=0)
    return Distances(
        t=t,
        p_greatest=float((1 + farther) / (1 + count)),
        p=(1 + farther_each) / (1 + count),
    )


def _distance(take: np.ndarray, references: np.ndarray) -> np.ndarray:
    """(...) t of ``take`` (...) from the ``references`` (N, ...)."""
    scale = references.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(references))
    return (take - references.mean(axis=0)) / scale


def assessment(take: str, model: str, fitted: int, verdict: TakeVerdict) -> str:
    """Return the verdict as a sentence, and one line of numbers per joint. ``fitted`` is the number
    of takes to compare with to which the ``model`` was fitted.
    """
    sizes = np.abs(verdict.span_t)
    joint, span = np.unravel_index(np.argmax(sizes), sizes.shape)
    return TAKE_TEXT.render(
        take=take,
        model=model,
        v=verdict,
        joint=verdict.evidence.index[1 + joint],
        t=verdict.span_t[joint, span],
        begins=verdict.ends[span],
        ends=verdict.ends[span + 1],
        fewest=FEWEST,
        fitted=fitted,
    )
