"""report: verdicts on the claims for every dataset, errata, model card, places of equations."""

from dataclasses import replace
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.recordings.inventory import other_files
from pipeline.verdicts import paper
from pipeline.verdicts import report_page as pages
from pipeline.verdicts.claims import CLAIMS, ClaimsFile, parse_claims, require_known
from pipeline.verdicts.decision import decide_each, reading_verdicts, verdict_table
from pipeline.verdicts.model_card import model_card
from pipeline.verdicts.run import read_runs

REPORTS, README = Path("reports"), Path("README.md")
PACKAGE, HERE = Path("pipeline"), Path("pipeline/verdicts")
BEYOND = (
    "studies",
    "tools",
)  # packages beyond the paper, which do not enter the report
DEFAULT = ("youbot", "paper")  # dataset and scale of the results in the README


def run() -> None:
    """Decide the claims with the numbers of every run; write the dataset's claims.csv, report.md,
    errata.md, model_card.md, recordings.md and summary.json, and datasets.md and equations.md. The
    default dataset's results are also written to the README.
    """
    name = config.sections("report").dataset.name
    runs, reports = read_runs(REPORTS / "datasets", first=name), REPORTS / name
    unfit = [
        f"The evidence of {run.dataset} {words}."
        for run in runs
        for place in [Path(f"data/raw/{run.dataset}/inventory.csv")]
        if (words := other_files(run.tables.get("raw_files"), place))
    ]
    for words in unfit:
        print(f"report: {words}")
    stated = validated(ClaimsFile, read_yaml(CLAIMS), file=CLAIMS)
    claims = require_known(parse_claims(stated.claims))
    named = {*stated.recordings_of_the_paper}.union(*(claim.why for claim in claims))
    if unknown := sorted(named - {*(known := config.option_names("dataset"))}):
        message = f"no dataset {', '.join(unknown)}; there are {', '.join(known)}"
        raise ConfigError(message, file=CLAIMS, key="why or recordings_of_the_paper")
    decided = decide_each(claims, runs, stated.recordings_of_the_paper)
    table = verdict_table(decided)
    runs = [pages.with_plain_names(run) for run in runs]
    decided = [pages.with_plain_cases(own) for own in decided]
    for n, run in enumerate(runs):
        if "readings" in run.tables:
            tables = run.tables | {"readings": reading_verdicts(claims, run)}
            runs[n] = replace(run, tables=tables)
    here = runs[0]
    errata = paper.parse_errata(read_yaml(HERE / "errata.yaml").get("errata"))
    items = paper.parse_items(read_yaml(HERE / "paper.yaml").get("items"))
    sources = paper.citations(PACKAGE, items, BEYOND)
    file = reports / "captions.json"
    captions = validated(
        dict[str, dict[str, str | list[str]]], read_yaml(file), file=file
    )
    written = {
        reports / "claims.csv": table.to_csv(index=False),
        reports / "report.md": pages.report_page(
            here, runs, decided, captions, items, sources, errata
        ),
        reports / "errata.md": paper.errata_page(errata, here, decided),
        reports / "model_card.md": model_card(here, runs[1:]),
        reports / "recordings.md": pages.recordings_page(here),
        REPORTS / "datasets.md": pages.datasets_page(decided, unfit),
        REPORTS / "equations.md": paper.equations_page(items, sources),
    }
    if (here.dataset, here.scale) == DEFAULT:
        text = README.read_text(encoding="utf-8")
        written[README] = pages.readme_with_results(text, here, decided)
    contracts.write_metrics(
        pages.summary_numbers(here, decided), reports / "summary.json"
    )
    for file, text in written.items():
        contracts.write_text(text, file)
