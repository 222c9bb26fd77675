"""The crate of the results names every file, and every stage with its inputs and outputs; the card
answers its questions; lock files are in the order of their pipelines; the page holds its Markdown
files whole, with links that lead somewhere and figures inside.
"""

import io
import json
import re
import shutil
import warnings
from base64 import b64decode
from collections.abc import Iterator
from math import nan
from pathlib import Path
from types import SimpleNamespace
from xml.etree.ElementTree import Element, fromstring

import pandas as pd
import pytest
from omegaconf import OmegaConf
from PIL import Image
from project_copy import run
from rocrate.rocrate import ROCrate
from source_code import MODULES, ROOT, covers, needed, package

from pipeline.core.errors import ContractError
from pipeline.tools.crate.command import PROFILE, QUALITY, card
from pipeline.tools.lock import command as lock
from pipeline.tools.page.command import RESULTS, page


def references(value: object) -> Iterator[str]:
    if isinstance(value, dict) and set(value) == {"@id"}:
        yield value["@id"]
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from references(each)


def written(laboratory: dict | None, stored: list[dict]) -> str:
    motion = SimpleNamespace(rate=125.0, steps=64)
    dataset = SimpleNamespace(name="lab", laboratory=laboratory, motion=motion)
    parts = {"take": list("abc"), "part": ["training", "training", "test"]}
    takes = pd.DataFrame(parts | {"left_out": [False, True, False]})
    counted = [["a tracker", "gaps", "count", 9.0, nan, 2.0, 4.0]]
    about = {"subject": "An arm", "source": "a laboratory", "licence": "CC0"}
    quality = pd.DataFrame(counted, columns=QUALITY)
    return card(SimpleNamespace(seed=7, dataset=dataset), about, stored, takes, quality)


def test_the_card_states_the_numbers_of_its_dataset_and_nothing_of_another_kind():
    text = written({"seed": 1}, [{"path": "data/raw/lab/x", "nfiles": 8, "size": 1234567}])
    parts = ["| training | 2 |", "64 steps at 125 per second", "leaves out: b.", "Licence: CC0."]
    parts += ["| `data/raw/lab/x` | 8 | 1,234,567 |", "from the seed 7;"]
    for part in (*parts, "| a tracker | gaps | count | 9 | – | 2 | 4 |"):
        assert part in text, part
    recorded = written(None, [])
    assert re.findall("^## .*", recorded, re.M) == re.findall("^## .*", text, re.M)
    for word in ("seed", "Simulated", "truth", "pipeline/laboratory", "dvc.lock"):
        assert word not in recorded, word
    assert "a laboratory" in recorded and "data/raw/lab/dataset.yaml" in recorded


@pytest.mark.slow
def test_a_run_is_described_file_by_file_and_stage_by_stage(reproduced, tmp_path):
    folder = tmp_path / "project"
    shutil.copytree(reproduced, folder, symlinks=True)
    file, written = folder / "reports/ro-crate-metadata.json", []
    for _ in range(2):
        done = run("python", "-m", "pipeline", "crate", cwd=folder)
        assert done.returncode == 0, done.stderr
        written.append(file.read_bytes())
    assert written[0] == written[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crate = ROCrate(file.parent)
    read = {entity.id for entity in crate.data_entities if entity.type == "File"}
    below = [one for one in file.parent.rglob("*") if one.is_file() and one != file]
    assert read == {one.relative_to(file.parent).as_posix() for one in below}
    locked = OmegaConf.to_container(OmegaConf.load(folder / "dvc.lock"))["stages"]
    assert {*locked, "page"} <= {entity["name"] for entity in crate.get_by_type("CreateAction")}
    entities = json.loads(written[0])["@graph"]
    named = {name for entity in entities for name in references(entity)}
    # every reference is described
    assert named - {each["@id"] for each in entities} == {"https://w3id.org/ro/crate/1.1"}
    (root,) = (each for each in entities if each["@id"] == "./")
    assert [*references(root["conformsTo"])] == [PROFILE]


@pytest.mark.parametrize(
    ("stage", "module"), [("studies_page", "tools.page.command"), ("crate", "tools.crate.command")]
)
def test_a_stage_depends_on_the_code_that_it_runs(stage, module):
    file = ROOT / "pipeline/tools/crate/dvc.yaml"
    deps = OmegaConf.to_container(OmegaConf.load(file))["stages"][stage]["deps"]
    core = {name for name in MODULES if package(name) == "core"}
    modules = [MODULES[name] for name in needed(f"pipeline.{module}", core)]
    files = [file.relative_to(ROOT).as_posix() for file in modules if file.stat().st_size]
    files.remove("pipeline/__init__.py")
    assert [file for file in files if not any(covers(dep, file) for dep in deps)] == []


def test_the_entries_of_a_lock_are_sorted_as_its_pipeline(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text("models: [a, b]\n")
    text = "stages:\n  record: {cmd: r}\n  fit: {cmd: f, matrix: {model: '${models}'}}\n"
    (tmp_path / "dvc.yaml").write_text(text)
    head = "schema: '2.0'\nstages:\n"
    record = "  record:\n    cmd: record\n    outs:\n    - path: x\n"
    a, b, gone = (f"  {n}:\n    cmd: {n}\n" for n in ("fit@a", "fit@b", "gone"))
    (tmp_path / "dvc.lock").write_text(head + b + gone + record + a)
    for printed in ("lock: dvc.lock put in order\n", "lock: every dvc.lock is in order\n"):
        lock.run()
        assert capsys.readouterr().out == printed
        assert (tmp_path / "dvc.lock").read_text() == head + record + a + b


MARKDOWN = re.compile(r"\*\*|\]\(|^\s*#+ |\|\s*---|^```|!\[", re.MULTILINE)

REPORT = """# Results: `lab` & more

First, see [Why](card.md#why-2), [the table](#a-table), [errata](errata.md#sign)
and [elsewhere](https://example.org/a).

## A table

| claim | of <all> |
| --- | --- |
| **x** below 1<br>y above | ✓ |

## A figure

![A drawn figure](figures/drawn.svg)
"""
CARD = "# Card\n\n## Why\n\nBecause.\n\n## Why\n\nAgain, of [the report](report.md).\n"


def parsed(html: str) -> Element:
    """Its tree, which no page has that is not well-formed."""
    closed = re.sub(r"<(meta[^>]*|br|hr)>", r"<\1/>", html)
    return fromstring(closed.removeprefix("<!doctype html>"))


def text(page: Element) -> str:
    """Text outside code."""
    for code in (each for tag in ("code", "style") for each in page.iter(tag)):
        code.text = ""
    return "".join(page.itertext())


@pytest.fixture
def reports(tmp_path: Path) -> Path:
    (tmp_path / "figures").mkdir()
    Image.new("RGB", (300, 200), "teal").save(tmp_path / "figures/drawn.png")
    (tmp_path / "report.md").write_text(REPORT, encoding="utf-8")
    (tmp_path / "card.md").write_text(CARD, encoding="utf-8")
    return tmp_path


def test_two_files_become_one_page(reports):
    html = page("Results <1>", [reports / "report.md", reports / "card.md"], reports)
    tree = parsed(html)
    assert "<title>Results &lt;1&gt;</title>" in html
    anchors = [each.get("id") for each in tree.iter() if each.get("id")]
    assert len(set(anchors)) == len(anchors)
    addresses = [each.get("href") for each in tree.iter("a")]
    inside = {address[1:] for address in addresses if address.startswith("#")}
    assert inside <= {*anchors} and {"card--why-2", "report--a-table", "card"} <= inside
    outside = [address for address in addresses if not address.startswith("#")]
    assert outside == ["errata.md#sign", "https://example.org/a"]
    contents = [each.text for each in tree.find(".//nav").iter("a")]
    assert contents == ["Results: lab & more", "A table", "A figure", "Card", "Why", "Why"]
    shown = text(tree)
    assert "of <all>" in shown and "<br>" not in shown and "Results: " in shown
    assert not MARKDOWN.search(shown)
    (figure,) = tree.iter("img")
    assert figure.get("alt") == "A drawn figure"
    kind, _, data = figure.get("src").partition(";base64,")
    with Image.open(io.BytesIO(b64decode(data))) as image:
        assert kind == "data:image/png" and image.size == (300, 200)
        assert image.convert("RGB").getpixel((5, 5)) == (0, 128, 128)
    for missing in ("figures/drawn.png", "card.md"):
        (reports / missing).unlink()
        with pytest.raises(ContractError, match=missing):
            page("", [reports / "card.md", reports / "report.md"], reports)


def test_figures_are_beside_each_other_with_their_text_and_a_card_is_folded(reports):
    figure = "![A figure](figures/drawn.png)\nCompare.\n- it holds<br>**lab ✓**\n\n"
    unseen = "<details><summary>2 more</summary>One. Two.</details>\n\n"
    text = f"# R\n\n## F\nKey.\n\n### One\n{figure}### Two\n{figure}{unseen}## Next\nThe end.\n"
    (reports / "report.md").write_text(text)
    (reports / "model_card.md").write_text("# Card\n\nAnswer.\n\n## Why\nA rule.\n\n## More\nx\n")
    tree = parsed(page("", [reports / "report.md", reports / "model_card.md"], reports))
    cards = [each for each in tree.iter("div") if each.get("class") == "card"]
    assert [each.find("h3").text for each in cards] == ["One", "Two"]
    for each in cards:
        picture, caption = each.findall("p")
        assert picture.find("img") is not None and caption.text == "Compare."
        assert each.find(".//strong").text == "lab ✓"
    assert "The end" not in "".join("".join(each.itertext()) for each in cards)
    folded = ["".join(each.itertext()).split() for each in tree.iter("summary")]
    assert folded == [["2", "more"], ["Why"], ["More"]]


def test_the_committed_report_reads_as_a_page():
    folder = ROOT / "reports/youbot"
    html = page("Results", [folder / file for file in RESULTS], folder)
    tree = parsed(html)
    assert not MARKDOWN.search(text(tree))
    addresses = [each.get("href") for each in tree.iter("a")]
    inside = {address[1:] for address in addresses if address.startswith("#")}
    assert inside <= {each.get("id") for each in tree.iter()}
    beside = [address.partition("#")[0] for address in addresses if ":" not in address]
    assert [name for name in beside if not (folder / name).exists()] == []
    assert not re.search(r"""(src|href)=["'](https?:)?//""", html.partition("<main>")[0])
