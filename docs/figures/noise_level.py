"""Writes docs/noise-level.md's figures and tables from the results kept in docs/noise-level.

`python docs/figures/noise_level.py [RESULTS_DIR...]`: without a folder all of docs/noise-level/NAME
are taken. Each has controllers.csv, cells.csv, calibration.csv and study.toml of one study. What
stands between `<!-- NAME -->` and `<!-- /NAME -->` on the page is replaced, and so is what stands
between the marks `together`; a study without marks on the page gets them at the end of the results.
"""

from __future__ import annotations

import sys
from pathlib import Path

from realitygap.errors import UsageError
from realitygap.report.noise.page import captions
from realitygap.report.noise.report import NoiseReport
from realitygap.report.noise.results import read_results

DOCS = Path(__file__).resolve().parent.parent
PAGE = DOCS / "noise-level.md"
FIGURES = {"noise-map": "map", "noise-claims": "claims", "noise-fitness": "fitness"}


def main() -> None:
    """Read the studies, draw them, write them into the page."""
    folders = [Path(name) for name in sys.argv[1:]] or sorted(
        file.parent for file in (DOCS / "noise-level").glob("*/study.toml")
    )
    if not folders:
        sys.exit("docs/noise-level holds no results yet: expected NAME/study.toml and its tables.")
    try:
        reports = {folder.resolve().name: NoiseReport(read_results(folder)) for folder in folders}
    except UsageError as error:
        sys.exit(str(error))
    page = PAGE.read_text("utf-8")
    for name, report in reports.items():
        print(f"{name} …", flush=True)
        page = replaced(page, name, study(name, report))
    page = replaced(page, "together", together(reports))
    PAGE.write_text(page, encoding="utf-8")
    print(f"wrote {PAGE}")


def study(name: str, report: NoiseReport) -> str:
    """One study's part of the page; its figures are written beside it."""
    target, told = DOCS / "figures", captions(report)
    command = report.results.settings.get("command", "realitygap study noise")
    parts = [f"```sh\n{command}\n```", report.paragraph]
    for which, word in FIGURES.items():
        file = f"noise-level-{name}-{word}"
        report.save_figure(which, target, file, dpi=130)
        (target / f"{file}.svg").unlink()
        parts += [f"![{word.capitalize()} of the study {name}](figures/{file}.png)", told[which]]
    headline = report.facts.headline.name.replace(" ", "-")
    claims = [f"{headline}-{key}" for key in "abc"]
    for table in (*claims, "peaks", "paper", "fitness", "names", "calibration"):
        one = report.tables[table]
        if one.rows:
            parts += [one.title, one.markdown()]
    return "\n\n".join(parts)


def together(reports: dict[str, NoiseReport]) -> str:
    """All studies in one table: verdicts and peaks. Does the peak stay at the noise that was measured?"""
    head = ["study", "twin's dial", "evaluations", "(a)", "(b)", "(c)", "peak (a)", "peak (c)"]
    lines = ["| " + " | ".join([*head, "noisiness passes zero"]) + " |", "|---" * (len(head) + 1) + "|"]
    for name, report in reports.items():
        settings, scope = report.results.settings, report.facts.headline
        verdicts = [finding.verdict for finding in scope.findings]
        row = report.tables["peaks"].texts()[0]
        facts = [f"{settings['twin_noise']:g}", str(settings.get("evaluations", "–"))]
        lines.append("| " + " | ".join([name, *facts, *verdicts, row[1], row[3], row[4]]) + " |")
    return "\n".join(lines)


def replaced(page: str, name: str, text: str) -> str:
    """The page with the text between a name's marks."""
    start, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    if start not in page:
        before, after = page.split("<!-- end of results -->")
        page = f"{before}### {name}\n\n{start}\n{end}\n\n<!-- end of results -->{after}"
    head, rest = page.split(start, 1)
    if end not in rest:
        sys.exit(f"{PAGE.name}: expected {end} after {start}, found none.")
    return f"{head}{start}\n\n{text}\n\n{end}{rest.split(end, 1)[1]}"


if __name__ == "__main__":
    main()
