"""What the documents say is true: their code runs, and their tables list what there is."""

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from mtp_bench import card_ids, load_card, load_submission
from mtp_bench.cards import DetectorSection, TaskSection
from mtp_bench.cards.card import PlannerSection
from mtp_bench.cards.source import SOURCES, source_class
from mtp_bench.core.bundle import baseline_names
from tests.conftest import REPOSITORY
from tests.support.command_line import CommandLine

PAGES = sorted(path.relative_to(REPOSITORY).as_posix() for path in (REPOSITORY / "docs").rglob("*.md"))
PAGES.remove("docs/generate/hub/dataset.md")  # its blocks run in the folder that it is written to: `test_hub`
DOCUMENTS = (
    "README.md", "CONTRIBUTING.md", "SECURITY.md", "envs/README.md", "baselines/README.md", "leaderboard/README.md",
    "leaderboard/RESULTS.md", "leaderboard/SUBMITTING.md", "leaderboard/MAINTAINING.md", "mtp_bench/detector/README.md",
    *PAGES,
)  # fmt: skip


def blocks(path: Path, language: str) -> list[str]:
    """Fenced blocks of one language that are written in a document; those that show a file run as that file."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(), flags=re.MULTILINE | re.DOTALL)
    return [text for text in found if not text.startswith("--8<--")]


def block(path: Path, language: str, contains: str) -> str:
    (found,) = [text for text in blocks(path, language) if contains in text]
    return found


def first_column(path: Path, prefix: str = "") -> set[str]:
    names = re.findall(r"^\| `([^`]+)` \|", path.read_text(), flags=re.MULTILINE)
    return {name for name in names if name.startswith(prefix)}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(repository: Path, document: str) -> None:
    path = repository / document
    for target in re.findall(r"\]\(([^)]+)\)", path.read_text()):
        file, _, heading = target.partition("#")
        if "://" not in target:
            assert (path.parent / file).exists(), target
        if heading and not file:
            titles = re.findall(r"^#+ (.+)$", path.read_text(), flags=re.MULTILINE)
            assert heading in {title.lower().replace(" ", "-") for title in titles}, target


def test_the_examples_run(repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for text in blocks(repository / "README.md", "python"):
        exec(compile(text, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("min_ade", "StandingStill"))


def test_the_example_of_the_detector_runs(repository: Path) -> None:
    found: dict[str, Any] = {}
    text = block(repository / "mtp_bench/detector/README.md", "python", "simulate(")
    exec(compile(text, "detector/README.md", "exec"), found)
    assert found["detections"].box.shape[1] == 7


def test_the_submission_passes_check(repository: Path, tmp_path: Path, cli: CommandLine) -> None:
    """Whichever page shows it."""
    pages = [repository / "README.md", *sorted(repository.glob("docs/start/*.md"))]
    (page,) = [page for page in pages if "standing_still/agent.py" in page.read_text()]
    folder = tmp_path / "standing_still"
    folder.mkdir()
    (folder / "submission.toml").write_text(block(page, "toml", "standing_still/submission.toml"))
    (folder / "agent.py").write_text(block(page, "python", "standing_still/agent.py"))
    assert "error" not in cli.ok("check", folder).splitlines()[-1]


def test_the_example_manifest_is_valid(repository: Path, tmp_path: Path) -> None:
    (tmp_path / "submission.toml").write_text(block(repository / "baselines/README.md", "toml", "[compare]"))
    (tmp_path / "agent.py").write_text("def build(task, hypotheses): ...")
    assert load_submission(tmp_path).compare.sweep == {"hypotheses": (5, 10, 20)}


def test_the_table_of_environments_is_complete(repository: Path) -> None:
    readme = repository / "docs/environment/index.md"
    assert first_column(readme, "MTP-") == set(card_ids())
    for env_id in card_ids():
        task = load_card(env_id).task
        (row,) = [line for line in readme.read_text().splitlines() if line.startswith(f"| `{env_id}` |")]
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        want = [f"{task.rate:g} Hz", f"{task.past}, {task.future} frames", str(task.samples), ", ".join(task.classes)]
        assert cells[2:] == want


def test_the_table_of_baselines_names_baselines(repository: Path) -> None:
    """A new baseline needs its folder alone; the table need not have it."""
    assert first_column(repository / "baselines/README.md") <= set(baseline_names())


def test_the_table_of_card_keys_is_complete(repository: Path) -> None:
    documented = (repository / "envs/README.md").read_text()
    keys = ["id", "summary", "reference", "detector", *(f"task.{key}" for key in TaskSection.model_fields)]
    sections: list[type[BaseModel]] = [*map(source_class, SOURCES), DetectorSection]
    unwritten = ("seeds", "detections_sha256", "detections", "scenes")  # of --detections, and of `with_scenes`
    keys += [key for section in sections for key in section.model_fields if key not in unwritten]
    keys += ["drive", *(f"drive.planner.{key}" for key in PlannerSection.model_fields)]
    keys += [f"seeds.{split}" for split in ("train", "val", "test")]
    for key in keys:
        assert f"`{key}`" in documented or f"`source.{key}`" in documented, key


def test_the_readme_is_short(repository: Path) -> None:
    """What it is, two commands, one picture beside its badges, one figure, one table, links."""
    text = (repository / "README.md").read_text()
    assert len(text.splitlines()) <= 130
    assert "execute a submission without a sandbox" in text
    assert text.count("![") - text.count("](docs/badges/") == 1
    assert text.count("<picture>") == 1
    assert len(re.findall(r"^\|[-:| ]+\|$", text, flags=re.MULTILINE)) == 1


CODE = ("", "sh", "bash", "python", "toml", "json", "diff", "bibtex")  # `text` is what programs print


def long_lines(page: Path, most: int) -> list[str]:
    """Lines of code of more than ``most`` characters, with their numbers."""
    found: list[str] = []
    language: str | None = None
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if fence := re.match(r" *```(\S*)", line):
            language = fence[1] if language is None else None
        elif language in CODE and len(line) > most:
            found.append(f"{number}: {line}")
    assert language is None, f"{page}: a block is open at the end"
    return found


@pytest.mark.needs("git")
def test_lines_of_code_are_not_cut(repository: Path) -> None:
    """A page of the site and GitHub show 78 characters of a line at usual widths."""
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=repository, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("this is not a clone, so no page is known to be tracked")
    pages = listed.stdout.splitlines()
    assert "README.md" in pages
    assert [f"{page}:{line}" for page in pages for line in long_lines(repository / page, 78)] == []


RUN_ELSEWHERE = re.compile(r"^<!-- blocks run in (\S+) -->$", flags=re.MULTILINE)


@pytest.mark.usefixtures("few_event_runs")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(REPOSITORY / page, "python")])
def test_python_blocks_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One after the other, as a reader would; a page may say which other test runs its blocks."""
    elsewhere = RUN_ELSEWHERE.findall((REPOSITORY / page).read_text())
    if elsewhere:
        (test,) = elsewhere
        assert Path(page).stem in (REPOSITORY / test).read_text(), f"{test} does not read {page}"
        return
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for text in blocks(REPOSITORY / page, "python"):
        exec(compile(text, page, "exec"), names)
