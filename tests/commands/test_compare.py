"""`mtp-bench compare` and `score`: one table of 80 columns, the verdict, the rest when asked."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.generate import json_keys
from mtp_bench.running import score
from mtp_bench.scoring.rows import Row
from tests.support.command_line import CommandLine, read_json, write_submission

pytestmark = pytest.mark.usefixtures("remembered_weights")


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_submission(tmp_path_factory.mktemp("agents") / "mine", "mine")


def keys_in(content: object) -> Iterator[str]:
    """Keys of a content of JSON; those of mappings by class, kind, reason or k are not fixed."""
    if isinstance(content, list):
        for each in content:
            yield from keys_in(each)
    elif isinstance(content, dict):
        for key, value in content.items():
            yield key
            if key in ("own", "tracking"):
                yield from keys_in([part for part in value.values() if isinstance(part, dict)])
            elif key not in ("own_events", "k_curve", "invalid", "skipped"):
                yield from keys_in(value)


def test_a_comparison(mine: Path, cli: CommandLine, known: list[str], tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    printed = cli.ok("compare", mine, *known, "--seeds", 1, "--jobs", 1, "--full", "--json", file)
    assert [line for line in printed.splitlines() if len(line.rstrip()) > 80] == []
    short, _, way_on = cli.ok("compare", mine, *known, "--seeds", 1, "--jobs", 1).rstrip().rpartition("\n")
    assert printed.startswith(short + "\n")  # the same numbers from fewer runs
    assert "--full" in way_on
    table, *further = printed.split("\n\n")
    assert table.startswith("MTP-Small-v0, 2 scenes, 1 seed: m, less is better")
    agent_lines = [line.split() for line in table.splitlines()[4:] if line.count("/") == 1 and "%" in line]
    agents = [words[0] for words in agent_lines]
    known = ["gt_tracks", "perfect_association_same_samples", "stp", "stp_same_samples", "stp_neighbours"]
    assert sorted(agents) == sorted([*known, "mine"]), "without stp_bends, since no target turns"
    errors = [float(words[2]) for words in agent_lines]
    assert errors == sorted(errors)  # agents are listed by bADE
    assert "\nOver all targets " in table
    text = " ".join(further[0].split())
    assert text.startswith("Over all targets detection and tracking together cost ")
    assert "event weights of 48 runs of 'stp' on these scenes" in text
    assert [part.split()[0] for part in further[1:6]] == ["All", "minADE/minFDE", "Subsets", "Error", "minADE/minFDE"]
    content = read_json(file)
    explained = set(re.findall(r"^\| `(\w+)`", json_keys.page(), flags=re.MULTILINE))
    assert set(keys_in(content)) - explained == set()


def test_a_stored_run_has_the_same_table(
    mine: Path, cli: CommandLine, known: list[str], tmp_path: Path, kitti: str
) -> None:
    cli.ok("run", mine, *known, "-o", tmp_path / "run", "--jobs", 1)
    printed = cli.ok("score", tmp_path / "run", "--data", kitti)
    assert printed.startswith("MTP-Small-v0, 2 scenes, 1 seed: m, less is better")
    assert [line.split()[:2] for line in printed.splitlines() if line.startswith("mine")] == [["mine", "2"]]
    assert "--full" in printed.splitlines()[-1]
    assert "\n\nSubsets" in cli.ok("score", tmp_path / "run", "--data", kitti, "--full")
    latex = tmp_path / "table.tex"
    content = json.loads(cli.ok("score", tmp_path / "run", "--data", kitti, "--json", "-", "--table", latex))
    assert latex.read_text().startswith("\\begin{table}\n\\caption{MTP-Small-v0, 2 scenes, 1 seed: m, less is better}")
    assert list(content) == ["env", "definitions", "rows", "condition", "paired", "details", "ms_per_frame", "skipped"]
    lines = score(tmp_path / "run", data=kitti).report.per_scene()
    assert lines[0].keys() - json_keys.PER_SCENE.keys() < set(Row.model_fields)
    assert sum(line["bADE_sum"] for line in lines) == pytest.approx(
        content["rows"][0]["error"] * content["rows"][0]["targets"]
    )
