"""Numbers, intervals and tables as text, and pages from the templates."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml

MISSING = "–"
# characters, other than line ends, with the marks that turn the direction of a line
CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
# start of a tag that the pages do not use themselves
TAG = re.compile(r'<(?=[A-Za-z/!?])(?!br>|a id="[\w-]+">|/a>|!--)')
# emphasis, code and targets of links in a name
MARKUP = re.compile(r"(?<!\\)[*`]|(?<=\])\(")
IMAGE = re.compile(r"(?<=.)!\[")  # in a name: the pages' own figures begin a line
WORDS = read_yaml(Path(__file__).with_name("words.yaml"))


def plain_name(model: str) -> str:
    """Return the name of ``model`` on the pages."""
    return WORDS["names"].get(model, model)


def number(value: float, digits: int = 4) -> str:
    """Return ``value`` with significant ``digits``; whole numbers in full, NaN as a dash."""
    if pd.isna(value):
        return MISSING
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    whole = float(value).is_integer() and abs(value) < 1e9
    return f"{value:,.0f}" if whole else f"{value:.{digits}g}"


def interval(low: float, high: float) -> str:
    """Return an interval in brackets."""
    return f"[{number(low)}, {number(high)}]"


def difference(row: Mapping[str, float], sign: int = 1) -> str:
    """Return the ``difference`` of a row times ``sign``, with its interval."""
    low, high = sorted([sign * row["low"], sign * row["high"]])
    return f"{number(sign * row['difference'])} {interval(low, high)}"


def offset(row: Mapping[str, float]) -> str:
    """Return the size of a difference with its interval, and "above" or "below"."""
    return (
        f"{difference(row)} above"
        if row["difference"] > 0
        else f"{difference(row, -1)} below"
    )


def escape_markup(name: object) -> object:
    """Return a ``name`` from a file as Markdown that shows it: no emphasis, code or link; no other
    value changes.
    """
    return MARKUP.sub(r"\\\g<0>", name) if isinstance(name, str) else name


def plain_page(text: str) -> str:
    """Return the Markdown ``text`` of a page, in which names come from files, without control
    characters and with all tags and images escaped that the pages do not use.
    """
    return IMAGE.sub(r"!\\[", TAG.sub("&lt;", CONTROL.sub(" ", text)))


def cell(value: object) -> str:
    """Return a cell of a Markdown table: numbers by :func:`number`; other values, in which names
    come from files, are plain text: no columns, no tags but line ends.
    """
    if isinstance(value, int | float | np.number):
        return number(value)
    plain = " ".join(plain_page(str(value)).split())
    return re.sub(r"<(?!br>)", "&lt;", plain).replace("|", r"\|")


def table(header: Iterable[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table of the :func:`cell` of each value."""
    lines = [[*map(cell, row)] for row in (header, *rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def join_names(names: Iterable[str]) -> str:
    """Return ``names`` separated by commas, with "and" before the last; "" for none."""
    *first, last = [*names] or [""]
    return " and ".join(filter(None, [", ".join(first), last]))


@cache
def _templates():
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    blocks = {"trim_blocks": True, "lstrip_blocks": True, "undefined": StrictUndefined}
    made = Environment(loader=loader, **blocks)
    for function in (
        number,
        interval,
        difference,
        offset,
        cell,
        table,
        plain_name,
        join_names,
        say,
    ):
        made.globals[function.__name__] = function
    return made


def worded(template: str, **values: object) -> str:
    """Return the text of a Jinja ``template`` with ``values`` in one line, as :func:`filled_in`."""
    return " ".join(filled_in(template, **values).split())


def filled_in(template: str, **values: object) -> str:
    """Return the text of a Jinja ``template`` with ``values``; raises ConfigError where it is none
    or lacks a value.
    """
    from jinja2 import TemplateError

    try:
        return _templates().from_string(template).render(values) + "\n"
    except TemplateError as error:
        raise ConfigError(f"not a template with these values: {error}") from None


def say(name: str, **values: object) -> str:
    """Return the sentences ``name`` of ``words.yaml`` with ``values``."""
    return worded(WORDS["sentences"][name], **values)


def render(template: str, **values: object) -> str:
    """Return the page of a file in ``templates``; blanks and blank lines of absent parts go."""
    text = _templates().get_template(template).render(values, words=WORDS)
    text = re.sub(r"\n{3,}", "\n\n", re.sub(r" +$", "", text, flags=re.MULTILINE))
    return plain_page(text.strip() + "\n")
