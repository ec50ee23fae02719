"""Tracker files of three programs in one table: which is best, and is it more than chance?"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas
import pytest

from tests.support.command_line import CommandLine, read_json

ON = ("--env", "MTP-Intersection-v0", "--scenes", "6")
Plant = Callable[[pandas.DataFrame], pandas.DataFrame]


def lose_ids(tracks: pandas.DataFrame) -> pandas.DataFrame:
    """A new id every six frames."""
    return tracks.assign(id=tracks["id"] * 1000 + (tracks["frame"] + tracks["id"]) // 6)


def come_late(tracks: pandas.DataFrame) -> pandas.DataFrame:
    """The boxes of the frame before."""
    late = tracks.assign(frame=tracks["frame"] + 1)
    return late[late["frame"] <= tracks["frame"].max()]


def add_ghosts(tracks: pandas.DataFrame) -> pandas.DataFrame:
    """Beside each object another one that is not there, as sure as it."""
    ghosts = tracks.assign(id=tracks["id"] + 100_000, x=tracks["x"] + 12, y=tracks["y"] + 9)
    return pandas.concat([tracks, ghosts])


PLANTS: dict[str, Plant] = {"ids": lose_ids, "late": come_late, "ghosts": add_ghosts}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of the tracks of stp, and of copies with a planted difference."""
    from mtp_bench import run
    from mtp_bench.running import export_tracks, open_run

    root = tmp_path_factory.mktemp("tracks")
    run("stp", ON[1], root / "run", scenes=6)
    export_tracks(open_run(root / "run"), root / "good")
    for name, plant in PLANTS.items():
        (root / name).mkdir()
        for path in (root / "good").iterdir():
            plant(pandas.read_csv(path)).to_csv(root / name / path.name, index=False)
    return root


def test_each_file_has_a_row_and_the_planted_order_is_found(cli: CommandLine, files: Path, tmp_path: Path) -> None:
    tracks = [word for name in ("ghosts", "good", "late", "ids") for word in ("--tracks", files / name)]
    output = cli("compare", "given_tracks", *ON, *tracks, "--seeds", 1, "--json", tmp_path / "a.json")
    assert output.status == 0, output.err
    content = read_json(tmp_path / "a.json")
    error = {row["agent"]: row["error"] for row in content["rows"] if row["subset"] == "all"}
    order = [f"given_tracks:{files / name}" for name in ("good", "ids", "late", "ghosts")]
    assert sorted(error, key=lambda name: error[name]) == order
    pairs = [row for row in content["paired"] if row["subset"] == "all"]
    assert len({frozenset((row["agent"], row["other"])) for row in pairs}) == 6
    assert all(row["p"] < 0.05 for row in pairs)
    for row in pairs:
        np.testing.assert_allclose(row["error"], error[row["agent"]] - error[row["other"]])
    assert "Differences of agents" in output.out


def test_a_page_shows_table_causes_moments_and_pictures(cli: CommandLine, files: Path, tmp_path: Path) -> None:
    for name in ("good", "ghosts"):
        output = cli("run", "given_tracks", *ON, "--tracks", files / name, "-o", tmp_path / name)
        assert output.status == 0, output.err
    output = cli("score", tmp_path / "good", tmp_path / "ghosts", "--page", tmp_path / "page.html")
    assert output.status == 0, output.err
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for text in (
        "Worst moments of good",
        "Worst moments of ghosts",
        "Differences of agents",
        "All targets of 6 scenes",
        "<th",
        "share",
    ):
        assert text in page
    assert page.count("data:image/png;base64,") == 4
    assert "good has the lowest bADE" in page
    assert str(tmp_path) not in page, "a page that is passed on names no folder of this machine"
    assert "http" not in page.replace("http-equiv", "")


def test_several_of_both_kinds_are_an_error(cli: CommandLine) -> None:
    kinds = ("--tracks", "a", "--tracks", "b", "--detections", "c", "--detections", "d")
    output = cli("compare", "given_tracks", *ON, *kinds)
    assert output.status == 2
    assert "got several, expected one" in " ".join(output.err.split())


def test_a_stored_run_beside_several_files_is_an_error(cli: CommandLine, files: Path) -> None:
    error = cli("compare", files / "run", *ON, "--tracks", files / "good", "--tracks", files / "ids").error
    assert "run is not a submission" in error


def test_the_verdict_is_of_the_run_that_was_asked_for(cli: CommandLine, files: Path) -> None:
    printed = cli("compare", "blind", files / "run", *ON, "--seeds", 1).out
    (verdict,) = [text for text in " ".join(printed.split()).split(". ") if text.startswith("Over all targets")]
    assert "stp_neighbours" not in verdict
    assert "; run has " in verdict
