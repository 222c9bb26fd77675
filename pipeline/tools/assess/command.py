"""``python -m pipeline assess FILE [--model FILE]``: comparison of a new recording of the motion
with the recordings that a model was fitted to.
"""

from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure

from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.typed_yaml import read_yaml
from pipeline.figures import style
from pipeline.models import load
from pipeline.models.closed_loop import MeanPath
from pipeline.models.exported import ExportedModel
from pipeline.models.model import Commands
from pipeline.perception.markers import follower
from pipeline.recordings.commands import commanded_steps
from pipeline.recordings.joint_logs import find_takes
from pipeline.recordings.motion_capture import marker_rows
from pipeline.recordings.repetitions import align, in_phase, stretch
from pipeline.statistics.takes import percentile_interval
from pipeline.tools.assess.judge import FEWEST, Innovations, TakeVerdict, filtered, judge

HERE, EXPORTS, OUT = Path(__file__).parent, Path("data/export"), Path("data/assess")
CHARACTERIZED = Path("data/characterize")  # runs of characterize, a folder a dataset
MOTION, TRACK = Path("data/ingest/motion"), Path("data/track")
ENOUGH = 20  # takes that were not fitted, from which on they are the reference alone
GREATEST = 8.0  # standard deviations at which a part is darkest
MODEL = f"exported model (default: the only one of params.yaml's dataset in {EXPORTS})"
ARGUMENTS = {
    "file": {"type": Path, "metavar": "FILE", "help": "recording, as the dataset's others are"},
    "--model": {"type": Path, "metavar": "FILE", "help": MODEL},
}


def run(file: Path, model: Path | None = None) -> None:
    """Filter each take in the recording by the exported model, print the verdict and draw it."""
    if model is None:
        name = config.sections("assess", HERE / "reads.yaml").dataset.name
        files = sorted(EXPORTS.glob(f"{name}_*.json"))
        if len(files) != 1:
            there_are = ", ".join(map(str, files)) or f"none of {name} in {EXPORTS}"
            message = f"name one exported model by --model; there is {there_are}; "
            message += "`python -m pipeline export MODEL` writes one"
            raise ConfigError(message, key="--model")
        model = files[0]
    law, file, out = load(model), file.resolve(), OUT.resolve()
    with chdir(run_folder(law.record["dataset"], model)):
        out.mkdir(parents=True, exist_ok=True)
        for name, text, figure in _assessed(file, law, model.name):
            print(text)
            style.save(figure, out, name)
            print(f"assess: drawn in {OUT / name}.png")


def run_folder(dataset: str, model: Path) -> Path:
    """Return the folder in which the stages ran on ``dataset``, here or by characterize.

    Raises ConfigError where there is no such run.
    """
    for folder in (Path(), CHARACTERIZED / dataset):
        composed = folder / config.COMPOSED
        if composed.is_file() and read_yaml(composed)["dataset"]["name"] == dataset:
            return folder
    message = f"the model is of the dataset {dataset}, of which no run is here; set dataset: "
    message += f"{dataset} in params.yaml and run `dvc repro`, or run characterize"
    raise ConfigError(message, file=model)


def _assessed(file: Path, law: ExportedModel, export: str) -> Iterator[tuple[str, str, Figure]]:
    """Name, verdict in words and picture of each take in the recording."""
    dataset = config.sections("assess", HERE / "reads.yaml").dataset
    names, q = contracts.stacked(joints := contracts.read("joints", TRACK), "q")
    fitted = (joints.drop_duplicates("take")["part"] == "training").to_numpy()
    chosen = ~fitted if np.sum(~fitted) >= ENOUGH else np.ones_like(fitted)
    own, mean, rate = np.array(names)[chosen], q[fitted].mean(axis=0), dataset.motion.rate
    takes = new_takes(file, dataset, mean)
    poses = np.concatenate([q[chosen], [*takes.values()]])
    path, share = MeanPath(law.chain, mean), law.record["closed_loop_share"]
    steps = commanded_steps(contracts.read("trajectory", MOTION), rate)
    commands = path.commands(share) if share > 0 else Commands(steps, path.path, 0.0)
    found = filtered(law, commands, poses)
    for number, name in enumerate(takes, len(own)):
        # a take of the dataset is compared with the others
        others = np.pad(own != name, (0, len(takes)))
        verdict = judge(found, number, others, dataset.robot.joints, rate)
        among = int(np.sum(fitted[chosen] & (own != name)))
        yield name, assessment(name, export, among, verdict), _draw(name, verdict, found, number)


def new_takes(file: Path, dataset: SimpleNamespace, mean: np.ndarray) -> dict[str, np.ndarray]:
    """Return by name the angles (M+1, n) in rad of each repetition in ``file``: one of a motion
    capture, of a joint log as many as it holds. ``mean`` (M+1, n) in rad is that of the dataset's
    takes, which a log is brought in phase with.

    Raises RecordingError for a file that the dataset's stages would refuse.
    """
    if not file.exists():
        raise RecordingError("there is no such file", file=file)
    if dataset.mocap is not None:
        rows, _ = marker_rows(file.stem, file, "test", dataset)
        return {file.stem: follower(dataset.robot, dataset.mocap)(rows, take=file.stem).q}
    options, steps = dataset.joint_log, dataset.motion.steps
    moving, rest = steps - 2 * options.rest, options.rest
    alone = replace(options, movements=file.name)
    single = SimpleNamespace(**vars(dataset) | {"joint_log": alone})
    takes, observed, _ = find_takes(file.resolve().parent, single, moving)
    if not takes:
        held = "; ".join(sorted(set(observed))) or "no motion"
        raise RecordingError(f"no repetition of the dataset's motion; it holds {held}", file=file)
    path, place = mean[rest : rest + moving + 1], align if rest else in_phase
    return {
        name: stretch(take.actual, place(take.actual, take.first, path) - rest, steps + 1)
        for name, take in takes.items()
    }


def assessment(take: str, model: str, fitted: int, verdict: TakeVerdict) -> str:
    """Return the verdict in a sentence, then a line of numbers for each joint; the ``model`` was
    fitted to ``fitted`` of the takes it is compared with.
    """
    count = int(verdict.others.sum())
    known = f", {fitted} of which the model was fitted to" if fitted else ""
    joint, span = np.unravel_index(np.argmax(np.abs(verdict.span_t)), verdict.span_t.shape)
    t, begins, ends = verdict.span_t[joint, span], *verdict.ends[span : span + 2]
    if verdict.shows:
        behaves = "behaves" if verdict.behaves else "does NOT behave"
        head = f"{take} {behaves} as the {count} takes it is compared with"
    else:
        head = f"no difference of {take} can be shown with {count} takes to compare with"
        head += f": record {FEWEST} or more"
    lines = [
        f"assess: {head}{known} ({model}).",
        f"  largest difference: {verdict.names[1 + joint]} from {begins:.3g} to {ends:.3g} s, "
        f"{'less' if t < 0 else 'more'} likely by {abs(t):.3g} of their standard deviations; "
        f"{100 * verdict.p_spans:.0f} % of such takes differ as much somewhere",
        f"  as a whole: {100 * verdict.p_whole:.0f} % of such takes differ as much; by chance up "
        f"to {200 * verdict.limit:.0f} % of takes of the same kind are called different",
        "  joint: log evidence of this take; mean ± standard deviation of the others (nats a step)",
    ]
    rows = zip(verdict.names, verdict.evidence, verdict.theirs, verdict.p, strict=True)
    for name, own, (mean, std), p in rows:
        lines.append(f"  {name}: {own:.4g}; {mean:.4g} ± {std:.2g}; {100 * p:.0f} % differ as much")
    return "\n".join(lines)


def _draw(take: str, verdict: TakeVerdict, found: Innovations, number: int) -> Figure:
    """Innovations of take ``number`` with ±2σ and the middle 95 % of the others, spans shaded."""
    looks = style.joint_lines(list(verdict.names[1:])).values()
    shape = (style.TWO_COLUMNS, 1.5, 0.85)
    figure, (grid,) = style.joint_panels(len(looks), style.panels_across(len(looks)), shape)
    t = np.linspace(0, verdict.ends[-1], found.error.shape[1] + 1)[1:]
    low, high = percentile_interval(found.error[verdict.others])
    thin, red = {"color": style.BLACK, "linewidth": 0.6}, style.VERMILLION
    for j, (look, axes) in enumerate(zip(looks, grid, strict=True)):
        for begin, end, off in zip(verdict.ends, verdict.ends[1:], verdict.span_t[j], strict=False):
            shade = min(abs(off) / GREATEST, 1.0) / 2
            axes.axvspan(begin, end, color=red, alpha=shade, linewidth=0)
        band = axes.fill_between(t, low[:, j], high[:, j], color=style.LIGHT_GREY, linewidth=0)
        bound, _ = axes.plot(t, found.std[number, :, j, None] * [2, -2], **thin)
        (error,) = axes.plot(t, found.error[number, :, j], color=red, linewidth=0.8)
        axes.set(title=look["label"], xlim=(0, t[-1]))
    grid[0].set_ylabel("innovation (rad)")
    unlike = "behaves as" if verdict.behaves else "does NOT behave as"
    compared = f"{unlike if verdict.shows else 'beside'} the {int(verdict.others.sum())}"
    figure.suptitle(f"{take} {compared} other takes", fontsize=9)
    labels = [take, "±2σ by the model", "95 % of the other takes"]
    figure.legend([error, bound, band], labels, loc="outside lower center", ncols=3)
    return figure
