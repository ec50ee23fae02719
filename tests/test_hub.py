"""The folders of a dataset and of a Space: made of the committed leaderboard, and as their descriptions say."""

import csv
import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from docs.generate.hub import DTYPES, hub_files
from mtp_bench.errors import MtpBenchError
from mtp_bench.viz.pages import source_of
from tests.support.board_records import HOSTILE
from tests.support.browser import CHROMIUM, DRIVER, MISSING, chromium

READ = {"Boolean": lambda text: {"True": True, "False": False}[text], "Integer": int, "Float": float, "Text": str}


@pytest.fixture(scope="module")
def folder(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hub")
    subprocess.run([sys.executable, "-m", "docs.generate.hub", str(made)], cwd=repository, check=True)
    return made


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_another_process_writes_the_same_bytes(folder: Path) -> None:
    written = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    assert {name: path.read_bytes() for name, path in written.items()} == {
        name: text.encode() for name, text in hub_files().items()
    }


@pytest.mark.parametrize("name", ["leaderboard", "scenes"])
def test_descriptions_fit_the_columns(folder: Path, name: str) -> None:
    card = (folder / "dataset/README.md").read_text(encoding="utf-8")
    metadata = json.loads((folder / "dataset/croissant.json").read_text(encoding="utf-8"))
    content, rows = (folder / f"dataset/{name}.csv").read_bytes(), rows_of(folder / f"dataset/{name}.csv")
    (file,) = (each for each in metadata["distribution"] if each["@id"] == f"{name}.csv")
    assert (file["sha256"], file["contentSize"]) == (hashlib.sha256(content).hexdigest(), f"{len(content)} B")
    (fields,) = (each["field"] for each in metadata["recordSet"] if each["@id"] == name)
    kinds = {each["source"]["extract"]["column"]: each["dataType"].removeprefix("sc:") for each in fields}
    described = re.findall(r"^\| `(.+)` \| \S.* \|$", card.partition(f"## Columns of {name}.csv")[2], re.MULTILINE)
    assert list(rows[0]) == list(kinds) == described[: len(kinds)]
    assert all(READ[kind](row[key]) is not None for row in rows for key, kind in kinds.items() if row[key])
    (config,) = (each for each in yaml.safe_load(card.split("---")[1])["configs"] if each["config_name"] == name)
    assert {each["name"]: each["dtype"] for each in config["features"]} == {k: DTYPES[v] for k, v in kinds.items()}


def test_scenes_add_up_to_the_board(folder: Path) -> None:
    sums: dict[str, list[float]] = {}
    for row in rows_of(folder / "dataset/scenes.csv"):
        total = sums.setdefault(row["digest"], [0.0, 0.0])
        total[0] += float(row["weight_all"])
        total[1] += float(row["weight_all"]) * float(row["bADE_all [m]"] or 0)
    board = rows_of(folder / "space/leaderboard.csv")
    public = {row["digest"]: float(row["public [m]"] or row["error [m]"]) for row in board}
    assert {digest: error / weight for digest, (weight, error) in sums.items()} == pytest.approx(public, rel=1e-5)


def test_example_of_the_card_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    made: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", Path("dataset/README.md").read_text(), re.DOTALL)[0], made)
    assert len(made["ranked"]) > 1
    assert made["scenes"]["scene"].isin(["0001"]).any()


def test_a_board_that_lacks_records_is_refused(repository: Path, tmp_path: Path) -> None:
    (tmp_path / "index.parts").symlink_to(repository / "leaderboard/index.parts")
    (tmp_path / "records").mkdir()
    with pytest.raises(MtpBenchError, match=r"records are either in .* or on its board; run `make pages` first"):
        hub_files(tmp_path)


@pytest.mark.skipif(None in (CHROMIUM, DRIVER), reason=MISSING)
def test_page_shows_names_as_text(folder: Path, tmp_path: Path) -> None:
    page = folder / "space/index.html"
    (script,) = re.findall("<script>(.*?)</script>", page.read_text(encoding="utf-8"), re.DOTALL)
    assert source_of(script) in page.read_text(encoding="utf-8").partition("<style>")[0]
    lines = [f'E,3.0,2,"{HOSTILE.replace(chr(34), 2 * chr(34))}",2.5,2,3', "E,3.0,1,plain,1.5,1,2", "F,3.0,,late,9,,"]
    text = "\n".join(["env,definitions,place,submission,error [m],interval_low,interval_high", *lines, ""])
    with chromium(tmp_path) as browser:
        browser.open(page)  # a file may not read the file beside it
        assert browser.wait_for("return document.getElementById('count').textContent.includes('http.server')")
        browser.script("start(parsed(arguments[0]))", text)
        shown = "return [...document.querySelectorAll('section:not([hidden]) .text')].map((cell) => cell.textContent)"
        assert browser.script(shown) == ["agent", HOSTILE, "plain", "agent", "late"]
        browser.click("th button")
        browser.type("#words", "pl")
        assert browser.script(shown)[:2] == ["agent", "plain"]
        assert browser.script("return document.images.length || window.hacked") == 0
