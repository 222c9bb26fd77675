"""Reader of exported models; its copy beside a model, by the tool export, needs only NumPy."""

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import ROWS, Chain, PlanarChain, SerialChain
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.models.joint_error.outlook import Outlook
from pipeline.models.kinds import build_model
from pipeline.models.model import corrected_command

FORMAT = "motion model 2"
UNLIMITED = {"lower": -np.inf, "upper": np.inf, "max_speed": np.inf}  # null in the file
# a value beyond its range by more than MARGIN·width + SLACK (range's unit) causes a warning
MARGIN = 0.05
SLACK = 1e-3
SCORED = 0.5  # s, longest horizon at which a joint error law is fitted and scored
# errors of a file that is not an exported model
INVALID = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    ModelDomainError,
)
SAME_PERIOD = 1e-6  # greatest relative difference of two periods


class UnconfirmedBands(UserWarning):
    """Warns of predicted standard deviations that held-out motions did not confirm."""


class OutsideRanges(UserWarning):
    """Warns of a pose, a command or a horizon outside the ranges that the model was fitted to."""


@dataclass(frozen=True)
class Exported:
    """A fitted law for steps of 1/rate s, and the ``record`` of its file. Methods warn
    :class:`OutsideRanges` once for each joint and row outside the ranges of the fit.
    """

    law: Any
    record: Mapping[str, Any]  # contents of the file
    chain: Chain | None = None
    _warned: set[str] = field(default_factory=set, compare=False)

    def __repr__(self) -> str:
        joints = ", ".join(self.record.get("joints", []))
        rate = self.record["rate_per_s"]
        return f"<motion model {self.record['model']}: {joints} at {rate:g}/s>"

    def require_period(self, period: float | None) -> None:
        """Raise ModelDomainError where ``period`` in s is not the period of the fit."""
        fitted = 1 / self.record["rate_per_s"]
        if period is not None and not abs(period / fitted - 1) <= SAME_PERIOD:
            raise ModelDomainError(
                f"the model {self.record['model']} is of steps of {fitted:.9g} s, not {period:g}: "
                "resample the commands, or fit a model at this rate",
            )

    def _array(
        self,
        name: str,
        values: Any,
        sizes: tuple[int, ...],
        unit: str,
    ) -> ndarray:
        """Return ``values`` as an array; ModelDomainError for another last axis than ``sizes``."""
        array = np.asarray(values, dtype=float)
        if array.ndim == 0 or array.shape[-1] not in sizes:
            message = f"{name} must have {' or '.join(map(str, sizes))} numbers in its last axis"
            raise ModelDomainError(f"{message} ({unit}), got shape {array.shape}")
        return array

    def _warn(self, what: str, values: ndarray) -> None:
        """Warn once for each joint or row of ``values`` outside the fitted ranges of ``what``."""
        ranges = self.record["ranges"].get(what, {})
        columns = np.moveaxis(values, -1, 0)
        for (name, ends), column in zip(ranges.items(), columns, strict=False):
            low = ends["least"]
            high = ends["greatest"]
            slack = SLACK + MARGIN * (high - low)
            beyond = column[(column < low - slack) | (column > high + slack)]
            topic = f"{what} of {name}"
            if beyond.size and topic not in self._warned:
                self._warned.add(topic)
                warnings.warn(
                    f"{topic}: {beyond.flat[0]:.4g} {ends['unit']} is outside the range "
                    f"{low:.4g} to {high:.4g} of the fit of the model {self.record['model']}",
                    OutsideRanges,
                    stacklevel=4,
                )


class ExportedModel(Exported):
    """Fitted law p(q_{k+1} | q_k) for the command v of a step of 1/rate s.

    ``q`` (..., n) are joint angles in rad. ``task_step`` v (m,) or (..., m) are task steps in m and
    rad, (m + n) for an arm with more joints than task rows; it is an argument by name, so that a
    step of the joints cannot be taken for it. All methods raise SingularJacobianError. They raise
    ModelDomainError for a wrong number of joints or rows, and for moments that do not exist or that
    the recordings do not determine.
    """

    def mean(self, q: ndarray, *, task_step: ndarray) -> ndarray:
        """(..., n) E[q_{k+1}] in rad."""
        return self.law.mean(self.chain, *self._arrays(q, task_step))

    def covariance(self, q: ndarray, *, task_step: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1}) in rad²."""
        return self.law.covariance(self.chain, *self._arrays(q, task_step))

    def step(self, q: ndarray, *, task_step: ndarray, rng: Generator) -> ndarray:
        """(..., n) one random next pose in rad for each of ``q``, as in a particle filter."""
        return self.law.sample(self.chain, *self._arrays(q, task_step), rng)

    def sample(
        self,
        q: ndarray,
        *,
        task_step: ndarray,
        size: int,
        rng: Generator,
    ) -> ndarray:
        """(size, ..., n) independent next poses in rad from the same ``q``."""
        q, v = self._arrays(q, task_step)
        return self.law.sample(self.chain, np.broadcast_to(q, (size, *q.shape)), v, rng)

    def log_density(
        self,
        q: ndarray,
        q_next: ndarray,
        *,
        task_step: ndarray,
        measurement=None,
    ) -> ndarray:
        """(...,) ln p(q_next | q) in rad⁻ⁿ. With a covariance ``measurement`` (n, n) in rad²,
        ``q_next`` includes normal measurement noise (a Wishart model then needs numba). Raises
        ModelDomainError for a step without a density, e.g. of a matrix model at rest.
        """
        q, v = self._arrays(q, task_step)
        q_next = np.asarray(q_next, float)
        return self.law.log_density(self.chain, q, v, q_next, measurement)

    def command(self, q: ndarray, target: ndarray, *, task_step: ndarray) -> ndarray:
        """Command (..., m) or (..., m + n): ``task_step`` plus κ times the displacement from the
        tip's pose at ``q`` to its ``target`` pose. κ = 0 for an open loop.
        """
        share = self.record["closed_loop_share"]
        q = np.asarray(q, float)
        return corrected_command(self.chain, q, task_step, target, share)

    def _arrays(self, q: ndarray, v: ndarray) -> tuple[ndarray, ndarray]:
        """Return ``q`` and ``v`` as arrays; warn of values outside the ranges of the fit."""
        n = len(self.chain.lower)
        m = len(self.chain.task)
        q = self._array("q", q, (n,), "rad")
        sizes = (m, m + n) if n > m else (m,)
        v = self._array("v", v, sizes, f"steps of {self.chain.task}")
        self._warn("pose", q)
        self._warn("speed", self.record["rate_per_s"] * v)
        return q, v


class ExportedErrors(Exported):
    """Fitted law of the errors e_k = q_k − c_k of n joints about their commanded angles c, as sent.
    It remembers the last errors and commands. ``lag`` in s is the delay of the run's measured
    angles behind the command, a number or (n,), if it is known; else the mean lag of the fit holds,
    and covariances include its spread. Joint steps c_{k+1} − c_k are arguments by name, in rad.
    """

    def predict(
        self,
        errors: ndarray,
        commands: ndarray,
        steps: int,
        lag: Any = None,
    ) -> tuple[ndarray, ndarray]:
        """Return mean (n,) in rad and covariance (n, n) in rad² of the recorded error, its rounding
        included, ``steps`` samples after the last of the known ``errors`` (K, n), or after a rest
        without errors (0, n). ``commands`` are the commanded angles in rad at these samples and at
        least the ``steps`` next ones. The arm rests at the first command before it; behind the last
        command its speed continues, which an arm that leads its command needs.
        """
        errors, commands = self._histories(errors, commands, lag)
        self._warn_of_horizon(steps)
        return self.law.predict(errors, commands, steps, lag)

    def log_density(
        self,
        errors: ndarray,
        commands: ndarray,
        next_error: ndarray,
        lag: Any = None,
    ) -> ndarray:
        """(...,) ln p in rad⁻ⁿ of ``next_error`` (..., n), as many samples after the last of
        ``errors`` (K, n) as ``commands`` has more rows than ``errors``.
        """
        errors, commands = self._histories(errors, commands, lag)
        next_error = self._array("next_error", next_error, (commands.shape[1],), "rad")
        steps = len(commands) - len(errors)
        self._warn_of_horizon(steps)
        mean, covariance = self.law.predict(errors, commands, steps, lag)
        outlook = Outlook(mean, np.diag(covariance), self.law.degrees)
        return outlook.log_probability(next_error, np.zeros(len(mean))).sum(axis=-1)

    def start(self, q: ndarray, commanded: ndarray, rng: Generator) -> ndarray:
        """(P, s) memory of first poses ``q`` (P, n) where ``commanded`` (n,) is the command."""
        n = len(self.law.joints)
        q = self._array("q", q, (n,), "rad")
        commanded = self._array("commanded", commanded, (n,), "rad")
        self._warn("pose", q)
        return self.law.first_memory(q, commanded, rng)

    def step(
        self,
        q: ndarray,
        memory: ndarray,
        *,
        joint_step: ndarray,
        rng: Generator,
    ) -> tuple[ndarray, ndarray]:
        """Return one random next pose (P, n) in rad and its memory (P, s) for each of ``q``, after
        the commanded ``joint_step`` (n,) or (P, n) in rad.
        """
        n = len(self.law.joints)
        joint_step = self._array("joint_step", joint_step, (n,), "rad a step")
        self._warn("joint speed", self.record["rate_per_s"] * joint_step)
        return self.law.follow(q, joint_step, memory, rng)

    def sample(
        self,
        q: ndarray,
        commanded: ndarray,
        *,
        joint_steps: ndarray,
        size: int,
        rng: Generator,
    ) -> ndarray:
        """(size, M + 1, n) poses in rad from ``q`` (n,) on, of arms that are commanded
        ``joint_steps`` (M, n) from the ``commanded`` angles (n,).
        """
        poses = [np.tile(np.asarray(q, float), (size, 1))]
        memory = self.start(poses[0], commanded, rng)
        for step in np.asarray(joint_steps, float):
            pose, memory = self.step(poses[-1], memory, joint_step=step, rng=rng)
            poses.append(pose)
        return np.stack(poses, axis=1)

    def warn_of_unconfirmed(self) -> None:
        """Warn of the standard deviations in ``not_known`` of the record."""
        not_known = self.record["not_known"]
        if not_known:
            first = "{parameter} is {found} (required: {required})"
            warnings.warn(
                f"bands not confirmed: {first.format(**not_known[0])}; {len(not_known)} such in "
                "record['not_known']",
                UnconfirmedBands,
                stacklevel=4,
            )

    def _histories(
        self,
        errors: ndarray,
        commands: ndarray,
        lag: Any,
    ) -> tuple[ndarray, ndarray]:
        """Return ``errors`` and ``commands`` as arrays; ModelDomainError for other shapes, and for
        values that are not numbers. Warn of errors and speeds outside the ranges of the fit.
        """
        n = len(self.law.joints)
        errors = self._array("errors", errors, (n,), "rad")
        commands = self._array("commands", commands, (n,), "rad")
        if errors.ndim != 2 or commands.ndim != 2 or len(commands) <= len(errors):
            raise ModelDomainError(
                f"errors and commands must be (K, {n}) and (K + steps, {n}), got shapes "
                f"{errors.shape} and {commands.shape}",
            )
        for name, array in {"errors": errors, "commands": commands}.items():
            finite = np.isfinite(array).all(axis=1)
            if not finite.all():
                row = int(finite.argmin())
                raise ModelDomainError(
                    f"{name} must be finite, got {array[row]} in row {row}; leave out the rows "
                    "before it, or fill it",
                )
        speed = self.record["rate_per_s"] * np.diff(commands, axis=0)
        self._warn("joint speed", speed)
        if len(errors):
            lag = self.law.lag if lag is None else lag
            speed_before = np.concatenate([speed[:1], speed])[: len(errors)]
            self._warn("error", errors + lag * speed_before)
        return errors, commands

    def _warn_of_horizon(self, steps: int) -> None:
        """Warn once of a prediction beyond the longest horizon of the fit."""
        period = 1 / self.record["rate_per_s"]
        ahead = steps * period
        if ahead > SCORED + period and "horizon" not in self._warned:
            self._warned.add("horizon")
            message = f"{ahead:.3g} s ahead is beyond {SCORED:g} s, the longest horizon of the fit"
            warnings.warn(message, OutsideRanges, stacklevel=3)


def _chain(record: Mapping[str, Any]) -> Chain:
    """Return the arm of a file; ContractError for a value of another type or shape."""
    kind = {"planar": PlanarChain, "serial": SerialChain}[record["kind"]]
    n = len(record["lower"])
    values = {name: value for name, value in record.items() if name != "kind"}
    shapes = {"origin": (2,), "links": (n, 2), "placements": (n + 1, 12)}
    for name, value in values.items():
        if name not in ("task", "length"):
            values[name] = _array(name, value, shapes.get(name, (n,)))
    sound = bool(np.all(values["lower"] <= values["upper"]))
    _require(sound, "arm.lower", "≤ arm.upper", repr(record["lower"]))
    if kind is PlanarChain:
        sound = set(values["signs"]) <= {-1, 1}
        _require(sound, "arm.signs", "1 or -1", repr(record["signs"]))
        return kind(**values)
    values["task"], length = tuple(values["task"]), values["length"]
    known_rows = {*values["task"]} <= {*ROWS}
    _require(known_rows, "arm.task", f"of {', '.join(ROWS)}", record["task"])
    sound = _is_number(length) and length > 0
    _require(sound, "arm.length", "a number > 0", repr(length))
    return kind(**values)


def _array(name: str, value: list, shape: tuple[int, ...]) -> ndarray:
    """Return the numbers ``value`` of the arm as an array; null is no limit."""
    if name in UNLIMITED:
        value = [UNLIMITED[name] if number is None else number for number in value]
    array = np.array(value)
    sound = array.shape == shape and array.dtype.kind in "bif"
    _require(sound, f"arm.{name}", f"numbers of shape {shape}", repr(value))
    return array


def read_exported(file: Path, period: float | None = None) -> Exported:
    """Read the model that the tool export wrote to ``file``. Raises ContractError for another file,
    with the key and value of what is not valid, and ModelDomainError for another ``period`` in s.
    """
    try:
        text = file.read_text("utf-8")
        record = json.loads(text, parse_float=_number, parse_constant=_number)
        _require_valid(record)
        law = build_model(record["parameters"])
        if law.traits.memory:
            model: Exported = ExportedErrors(law, record)
            model.warn_of_unconfirmed()
        else:
            model = ExportedModel(law, record, _chain(record["arm"]))
    except ContractError as error:
        raise ContractError(error.message, file=file) from None
    except INVALID as error:
        reason = f"no key {error}" if isinstance(error, KeyError) else f"{error}"
        message = f"not an exported model ({reason}); write one by python -m pipeline export MODEL"
        raise ContractError(message, file=file) from None
    model.require_period(period)
    return model


def _require_valid(record: Any) -> None:
    """Raise ContractError with key and value for invalid contents of a file."""
    stated = record.get("format") if isinstance(record, dict) else type(record).__name__
    _require(stated == FORMAT, "format", repr(FORMAT), repr(stated))
    rate = record["rate_per_s"]
    share = record["closed_loop_share"]
    _require(_is_number(rate) and rate > 0, "rate_per_s", "a number > 0", repr(rate))
    sound = _is_number(share) and 0 <= share <= 1
    _require(sound, "closed_loop_share", "a number from 0 to 1", repr(share))
    # a law may state them too
    for key, name in (("rate_per_s", "rate"), ("joints", "joints")):
        value = record.get(key)
        of_law = record["parameters"].get(name, value)
        rule = f"{of_law!r} as parameters.{name}"
        _require(of_law == value, key, rule, repr(value))
    for quantity, ranges in record["ranges"].items():
        for name, ends in ranges.items():
            sound = ends["least"] <= ends["greatest"]
            key = f"ranges.{quantity}.{name}"
            _require(sound, key, "least ≤ greatest", repr(ends))


def _number(text: str) -> float:
    number = float(text)
    _require(bool(np.isfinite(number)), "numbers", "finite", text)
    return number


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _require(sound: bool, key: str, rule: str, value: str) -> None:
    if not sound:
        raise ContractError(
            f"{key} must be {rule}, got {value}; export the model again",
        )
