"""report: verdicts on the claims for every dataset, errata, model card, places of equations."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import ConfigError
from pipeline.core.results import (
    EVIDENCE,
    REPORTS,
    SMOKE,
    evidence_folder,
    pages_folder,
)
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.recordings.inventory import other_files
from pipeline.verdicts import paper
from pipeline.verdicts import report_page as pages
from pipeline.verdicts.claims import (
    CLAIMS,
    Claim,
    ClaimsFile,
    parse_claims,
    require_known,
)
from pipeline.verdicts.decision import decide_each, reading_verdicts, verdict_table
from pipeline.verdicts.model_card import model_card
from pipeline.verdicts.open_choices import errata_details
from pipeline.verdicts.run import Run, project_version, read_runs
from pipeline.verdicts.tally import groups_of, tally

README = Path("README.md")
PACKAGE = Path("pipeline")
HERE = Path("pipeline/verdicts")
# packages beyond the paper, which do not enter the report
BEYOND = ("studies", "tools")
DEFAULT = ("youbot", "paper")  # dataset and scale of the results in the README


def run() -> None:
    """Decide the claims with the numbers of every run; write the dataset's claims.csv, report.md,
    errata.md, model_card.md, recordings.md and summary.json, and datasets.md and equations.md. The
    default dataset's results are also written to the README. The numbers of a trial are not
    decided, and its pages do not replace those of another scale.
    """
    settings = config.sections("report")
    name = settings.dataset.name
    scale = settings.scale.name
    place = pages_folder(name, scale)
    evidence = evidence_folder(name, scale)
    runs = read_runs(REPORTS / EVIDENCE, evidence / EVIDENCE / f"{name}.json")
    here = runs[0]
    claims_file = read_claims_file()
    claims = require_known(parse_claims(claims_file.claims))
    require_datasets(claims, claims_file.recordings_of_the_paper)
    counted, unfit = counted_runs(runs)
    decided = decide_each(claims, counted, claims_file.recordings_of_the_paper)
    table = verdict_table(decided)
    decided = [pages.with_plain_cases(column) for column in decided]
    counted = [with_readings(pages.with_plain_names(run), claims) for run in counted]
    here = with_readings(pages.with_plain_names(here), claims)
    groups = groups_of(counted, decided)
    rows = tally(groups)

    items = paper.parse_items(read_yaml(HERE / "paper.yaml").get("items"))
    errata = paper.parse_errata(read_yaml(HERE / "errata.yaml").get("errata"))
    sources = paper.citations(PACKAGE, items, BEYOND)
    drawn = pages.Drawn(read_captions(place / name / "captions.json"), items, sources)
    of_here = decide_each(claims, [here], claims_file.recordings_of_the_paper)
    if here.scale == SMOKE:
        report = pages.trial_page(here, drawn)
    else:
        edition = pages.Edition(project_version(), settings.seed)
        report = pages.report_page(here, groups, rows, drawn, errata, edition)
    written = {
        place / name / "claims.csv": table.to_csv(index=False),
        place / name / "report.md": report,
        place / name / "errata.md": paper.errata_page(
            errata,
            here,
            of_here,
            counted,
            errata_details(here, groups),
        ),
        place / name / "model_card.md": model_card(here, _others(here, counted)),
        place / name / "recordings.md": pages.recordings_page(here, drawn.captions),
    }
    if evidence == REPORTS:
        datasets = pages.datasets_page(groups, rows, unfit)
        equations = paper.equations_page(items, sources)
        written[REPORTS / "datasets.md"] = datasets
        written[REPORTS / "equations.md"] = equations
    if (here.dataset, here.scale) == DEFAULT:
        text = README.read_text(encoding="utf-8")
        written[README] = pages.readme_with_results(text, groups, rows)
    summary = pages.summary_numbers(here, rows)
    contracts.write_metrics(summary, place / name / "summary.json")
    for file, text in written.items():
        contracts.write_text(text, file)


def read_claims_file() -> ClaimsFile:
    """Return the content of ``claims.yaml``."""
    return validated(ClaimsFile, read_yaml(CLAIMS), file=CLAIMS)


def read_captions(file: Path) -> dict[str, dict[str, str | list[str]]]:
    """Return the captions of the figures by name."""
    kind = dict[str, dict[str, str | list[str]]]
    return validated(kind, read_yaml(file), file=file)


def require_datasets(claims: Sequence[Claim], papers: Sequence[str]) -> None:
    """Raise ConfigError for a reason or a dataset of the ``papers`` that names no dataset."""
    named = {*papers}.union(*(claim.why for claim in claims))
    datasets = config.option_names("dataset")
    unknown = sorted(named - {*datasets})
    if unknown:
        message = f"no dataset {', '.join(unknown)}; there are {', '.join(datasets)}"
        raise ConfigError(message, file=CLAIMS, key="why or recordings_of_the_paper")


def counted_runs(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Return the ``runs`` that are no trials, and printed sentences on trials, on evidence of
    another version of the project and on evidence of other recordings than the dataset's.
    """
    sentences = []
    version = project_version()
    for run in runs:
        if run.scale == SMOKE:
            sentences.append(
                f"The evidence of {run.dataset} is a trial's: not counted.",
            )
        if run.version != version:
            earlier = run.version or "an unknown version"
            sentences.append(
                f"The evidence of {run.dataset} is of {earlier}, this is version"
                f" {version}; run the dataset again.",
            )
        inventory = Path(f"data/raw/{run.dataset}/inventory.csv")
        words = other_files(run.tables.get("raw_files"), inventory)
        if words:
            sentences.append(f"The evidence of {run.dataset} {words}.")
    for sentence in sentences:
        print(f"report: {sentence}")
    return [run for run in runs if run.scale != SMOKE], sentences


def with_readings(run: Run, claims: Sequence[Claim]) -> Run:
    """Return ``run`` with the verdicts under each reading in place of their evidence."""
    if "readings" not in run.tables:
        return run
    verdicts = reading_verdicts(claims, run)
    return replace(run, tables=run.tables | {"readings": verdicts})


def _others(here: Run, runs: Sequence[Run]) -> list[Run]:
    return [run for run in runs if run.dataset != here.dataset]
