"""Broken, empty and odd data through the commands: one clear error or a counted skip, and nothing half-written."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.command_line import CommandLine, read_json
from tests.support.small_scenes import write_kitti

pytestmark = pytest.mark.usefixtures("remembered_weights")
LABELS = "training/label_02/0006.txt"
MAP = "evaluate_tracking.seqmap.val"
SKIPPED = "3 rows of the data skipped or completed: detection not finite (2), detection size not above 0 (1)"


@pytest.fixture
def kitti(tmp_path: Path) -> Path:
    return Path(write_kitti(tmp_path / "data")) / "kitti_tracking"


def cut(name: str, characters: int) -> Callable[[Path], Any]:
    return lambda root: (root / name).write_text((root / name).read_text()[:-characters])


BROKEN: dict[str, tuple[Callable[[Path], Any], str]] = {  # one of each kind; tests/sources has them all
    "a row": (cut(LABELS, 30), "column 15 (y) is missing: is the file cut off?"),
    "a file": (lambda root: (root / "detections/pointrcnn/Car/0006.txt").unlink(), "Car/0006.txt"),
    "the map": (lambda root: (root / MAP).write_text(""), "names no sequence"),
}
GONE = {"another root": (lambda root: root.rename(root.with_name("kitti")), "no KITTI tracking data: ")}


@pytest.mark.parametrize(("break_it", "message"), (BROKEN | GONE).values(), ids=(BROKEN | GONE).keys())
def test_broken_data_is_one_clear_error(
    break_it: Callable[[Path], Any], message: str, cli: CommandLine, tmp_path: Path, kitti: Path, card: str
) -> None:
    common = ("--env", card, "--data", kitti.parent)
    run, file = tmp_path / "earlier", tmp_path / "a.json"
    cli.ok("run", "stp", *common, "-o", run, "--jobs", 1)
    break_it(kitti)
    jobs = 2 if message.endswith("cut off?") else 1  # errors come from workers too
    assert message in cli("run", "stp", *common, "-o", tmp_path / "run", "--jobs", jobs).error
    assert message in cli("compare", "stp", *common, "--json", file, "--jobs", 1).error
    assert message in cli("score", run, "--data", kitti.parent, "--json", file).error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "earlier"]


def test_scenes_without_objects(cli: CommandLine, tmp_path: Path, kitti: Path, card: str) -> None:
    (kitti / MAP).write_text("0008 empty 000000 000004\n")
    common = ("--env", card, "--data", kitti.parent)
    cli.ok("compare", "stp", "mtp", *common, "--json", tmp_path / "a.json", "--jobs", 1, "--seeds", 1)
    undefined = [
        "minADE", "minFDE", "error", "plain_error", "energy_score", "coverage", "gap_closed", "interval", "place",
    ]  # fmt: skip
    rows = read_json(tmp_path / "a.json")["rows"]
    assert len(rows) == 14 * 7
    for row in rows:
        assert {row[key] for key in ("targets", "objects", "scenes")} == {0}
        assert [row[key] for key in undefined] == [None] * len(undefined)
    cli.ok("run", "stp", *common, "-o", tmp_path / "run", "--jobs", 1)
    cli.ok("score", tmp_path / "run", "--data", kitti.parent, "--json", tmp_path / "b.json")
    assert read_json(tmp_path / "b.json")["rows"][0]["targets"] == 0


def spoil(root: Path) -> None:
    """Three rows in two of the three sequences that no agent can use."""
    row = "2,2,0,0,50,50,{score},{size},1.6,4,-10,0.8,30,0.1,0\n"
    with (root / "detections/pointrcnn/Car/0001.txt").open("a") as file:
        file.write("\n" + row.format(score="nan", size=1.5) + row.format(score=2.0, size=0))
    with (root / "detections/pointrcnn/Car/0006.txt").open("a") as file:
        file.write("\n" + row.format(score="inf", size=1.5))


def test_skipped_rows_are_counted_for_the_user(cli: CommandLine, tmp_path: Path, kitti: Path, card: str) -> None:
    common = ("--env", card, "--data", kitti.parent)
    compared = ("compare", "stp", *common, "--seeds", 1, "--jobs", 1, "--json")
    for name in ("clean", "spoilt"):
        file, run = tmp_path / f"{name}.json", tmp_path / name
        said = [
            cli.ok("data", *common), cli.ok("run", "stp", *common, "-o", run, "--jobs", 1),
            cli.ok("score", run, "--data", kitti.parent), cli.ok(*compared, file),
        ]  # fmt: skip
        assert [" ".join(text.split()).count(SKIPPED) for text in said] == [name == "spoilt"] * 4
        assert [text.count("skipped ") for text in said] == [name == "spoilt"] * 4
        spoil(kitti)
    clean, spoilt = (read_json(tmp_path / f"{name}.json") for name in ("clean", "spoilt"))
    assert (clean["skipped"], spoilt["skipped"]) == ({}, {"detection not finite": 2, "detection size not above 0": 1})
    assert clean["rows"] == spoilt["rows"]
