"""The folders of a dataset and of a Space: made of the committed leaderboard, and as their descriptions say."""

import csv
import hashlib
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from docs.generate.hub import DTYPES, hub_files
from mtp_bench.core.errors import MtpBenchError
from tests.support.board_records import HOSTILE
from tests.support.browser import chromium


@pytest.fixture(scope="module")
def folder(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hub")
    subprocess.run([sys.executable, "-m", "docs.generate.hub", str(made)], cwd=repository, check=True)
    return made


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_another_process_writes_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    written = {path.relative_to(folder).as_posix(): path.read_text("utf-8") for path in folder.glob("*/*")}
    assert written == hub_files()
    (tmp_path / "records").mkdir()
    (tmp_path / "index.parts").mkdir()
    (tmp_path / "index.parts/leaderboard.json").write_text('{"rows": [{"digest": "0"}]}')
    with pytest.raises(MtpBenchError, match=r"\d+ records are not both in .* and on its board; run `make pages`"):
        hub_files(tmp_path)


@pytest.mark.parametrize("name", ["leaderboard", "scenes"])
def test_descriptions_fit_the_columns(folder: Path, name: str) -> None:
    card = (folder / "dataset/README.md").read_text("utf-8")
    metadata = json.loads((folder / "dataset/croissant.json").read_text("utf-8"))
    path = folder / f"dataset/{name}.csv"
    sums = {each["@id"]: each["sha256"] for each in metadata["distribution"]}
    assert sums[path.name] == hashlib.sha256(path.read_bytes()).hexdigest()
    (fields,) = (each["field"] for each in metadata["recordSet"] if each["@id"] == name)
    kinds = {each["source"]["extract"]["column"]: each["dataType"].removeprefix("sc:") for each in fields}
    described = re.findall(r"^\| `(.+)` \| \S.* \|$", card.partition(f"## Columns of {path.name}")[2], re.MULTILINE)
    rows = rows_of(path)
    assert list(rows[0]) == list(kinds) == described[: len(kinds)]
    numbers = [key for key, kind in kinds.items() if kind in ("Integer", "Float")]
    assert all(math.isfinite(float(row[key])) for row in rows for key in numbers if row[key])
    (config,) = (each for each in yaml.safe_load(card.split("---")[1])["configs"] if each["config_name"] == name)
    assert {each["name"]: each["dtype"] for each in config["features"]} == {k: DTYPES[v] for k, v in kinds.items()}


def test_scenes_add_up_and_the_example_of_the_card_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    made: dict[str, list[str]] = {}
    exec(re.findall(r"```python\n(.*?)```", Path("dataset/README.md").read_text("utf-8"), re.DOTALL)[0], made)
    assert len(made["ranked"]) > 1
    sums: dict[str, list[float]] = {}
    for row in rows_of(Path("dataset/scenes.csv")):
        total, weight = sums.setdefault(row["digest"], [0.0, 0.0]), float(row["weight_all"])
        total[:] = total[0] + weight * float(row["bADE_all [m]"] or 0), total[1] + weight
    public = {row["digest"]: row["public [m]"] or row["error [m]"] for row in rows_of(Path("space/leaderboard.csv"))}
    assert {each: error / weight for each, (error, weight) in sums.items()} == pytest.approx(
        {each: float(error or 0) for each, error in public.items()}, rel=1e-5
    )


@pytest.mark.needs("browser")
def test_page_runs_and_shows_names_as_text(folder: Path, tmp_path: Path) -> None:
    lines = ["env,place,submission,error [m]", f'E,2,"{HOSTILE.replace(chr(34), 2 * chr(34))}",2.5', "E,1,plain,1", ""]
    with chromium(tmp_path) as browser:
        browser.open(folder / "space/index.html")  # from disk a page may not read the file beside it
        assert browser.wait_for("return document.getElementById('count').textContent.includes('http.server')")
        browser.script("start(parsed(arguments[0]))", "\n".join(lines))
        shown = "return [...document.querySelectorAll('tr:not([hidden]) .text')].map((cell) => cell.textContent)"
        assert browser.script(shown) == ["agent", HOSTILE, "plain"]
        browser.click("th button")
        assert browser.script(shown) == ["agent", "plain", HOSTILE]
        browser.type("#words", "pl")
        assert browser.script(shown) == ["agent", "plain"]
        assert browser.script("return document.images.length || window.hacked || 0") == 0
