"""Names from files are plain text wherever they are printed: terminal, pages, HTML and figures."""

import sys
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from motive_files import rows_file

from pipeline.__main__ import main
from pipeline.core.errors import RecordingError
from pipeline.figures import style, wrench
from pipeline.tools.inspect import command
from pipeline.tools.page.command import page as html_page
from pipeline.verdicts.decision import Case, Decided, Verdict
from pipeline.verdicts.report_page import with_plain_cases, with_plain_names
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import plain_page, table

TURNED = "a\u202eb"  # the rest of its line is shown from right to left
MARKUP = ["[l](http://x.org)", "**a**", "`a`"]  # of a name that is not shown as it is
NAMES = [
    "a|b",
    "<img src=x onerror=1>",
    "<script>x</script>",
    "$x^{$",
    "a\x1b[2Jb",
    "c\x9b1md",
]


class Tags(HTMLParser):
    """Names of the tags in an HTML page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list) -> None:
        self.names.append(tag)


def shown(name: str) -> str:
    """The name on the pages of a run."""
    rows = pd.DataFrame({"joint": [name]})
    run = Run("lab", "paper", True, [name], ["x"], {}, {"fit": {name: 1}}, {"t": rows})
    run = with_plain_names(with_plain_names(run))
    (plain,) = run.joints
    assert [*run.metrics["fit"]] == [plain]
    assert run.tables["t"]["joint"].tolist() == [plain]

    unknown = [None] * (len(Case._fields) - 1)
    case = Case(name, *unknown)
    verdict = Verdict(None, "", (case,))
    decided = with_plain_cases(Decided("lab", "real", [verdict]))
    assert decided.verdicts[0].cases == (case._replace(case=plain),)
    return plain


@pytest.mark.parametrize("name", [*NAMES, TURNED, "![i](x.png)", *MARKUP])
def test_a_name_on_a_page_adds_no_tag_column_or_control_character(name, tmp_path):
    def tags(word: str) -> list[str]:
        rows = table([word, "value"], [[word, 1.0]])
        text = plain_page(
            f"# Results of {word}\n\nJoint {word} moves.\n\n## Rows\n{rows}\n",
        )
        assert not any(
            words in text for words in ("\x1b", "\x9b", "\u202e", "<img", "<script")
        )
        (tmp_path / "report.md").write_text(text, encoding="utf-8")
        return Tags(html_page("Results", [tmp_path / "report.md"], tmp_path)).names

    assert tags(shown(name)) == tags("plain") and tags("plain").count("td") == 2
    assert name in MARKUP or tags(name) == tags("plain")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_a_figure_is_no_formula(name, tmp_path):
    panels, _ = style.model_panels([name], [name], "error")
    panels.savefig(tmp_path / "panels.svg")
    rows = pd.DataFrame({"value": np.linspace(-2, 2, 9), "density": 1.0})
    drawn = rows.assign(configuration=name, row="fx", source="measured")
    marginals = wrench.wrench_marginals(drawn, "recorded")
    marginals.savefig(tmp_path / "wrench.svg")


@pytest.mark.parametrize("name", ["a\x1b[2Jb", "c\x9b1md", TURNED])
def test_a_name_on_the_terminal_has_no_control_character(
    name,
    tmp_path,
    monkeypatch,
    capsys,
):
    rows = [f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)]
    rows_file(tmp_path, f"rigidbody,{name},1,0", *rows)
    for words in ([], ["--json"]):
        monkeypatch.setattr(sys, "argv", ["pipeline", "inspect", str(tmp_path), *words])
        assert main() == 0
    monkeypatch.setattr(command, "within", lambda *_: refuse(name))
    assert main() == 1

    printed = capsys.readouterr()
    assert not any(c in printed.out + printed.err for c in "\x1b\x9b\u202e")
    assert name[2:] in printed.err


def refuse(name: str) -> None:
    raise RecordingError("no such take", take=name)
