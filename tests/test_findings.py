"""Findings of README and RESULTS.md in their tables, which are made of records: what the words beside them claim."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest

BLOCK = re.compile(r"<!-- table: [^>]*-->\n\n(.*?)\n\n<!-- /table -->", re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
ALL, IDS, REACQUIRED = COLUMNS = "all targets (m)", "identity switch (m)", "reacquired (m)"
NUSCENES = {"nuScenes", "nuScenes-CenterPoint"}
JUNCTIONS = {"Intersection", "IntersectionRaw", "Roundabout"}
SIMULATED = {*JUNCTIONS, "Highway", "Merge"}
PEOPLE = {"WILDTRACK", "PETS", "ETH-UCY"}

Row = Mapping[str, str]
Tables = list[list[dict[str, str]]]


class Cell(NamedTuple):
    """Number of a cell and the ends of its interval, if it has one."""

    value: float
    ends: tuple[float, float] | None

    @property
    def below(self) -> bool:
        """Whether the whole interval is below 0."""
        return self.ends is not None and self.ends[1] < 0

    @property
    def level(self) -> bool:
        """Whether the interval holds 0."""
        return self.ends is not None and self.ends[0] <= 0 <= self.ends[1]


def cell(row: Row, key: str) -> Cell:
    value, *ends = (float(number) for number in NUMBER.findall(row[key].replace("−", "-")))
    return Cell(value, (ends[0], ends[1]) if ends else None)


def env(row: Row) -> str:
    return row["environment"].removeprefix("MTP-").removesuffix("-v0")


def of_envs(rows: Iterable[Row], key: str) -> dict[str, Cell]:
    return {env(row): cell(row, key) for row in rows}


def below(rows: Iterable[Row], key: str) -> set[str]:
    """Environments of significant gains."""
    return {name for name, each in of_envs(rows, key).items() if each.below}


def tables(path: Path) -> Iterator[list[dict[str, str]]]:
    """Tables of a page in their order, cells by the headings of their columns."""
    for block in BLOCK.findall(path.read_text(encoding="utf-8")):
        heading, _, *lines = ([each.strip() for each in line.strip("|").split("|")] for line in block.splitlines())
        yield [dict(zip(heading, line, strict=True)) for line in lines]


@pytest.fixture(scope="module")
def drives(repository: Path) -> dict[str, Any]:
    """Figures of the study of driving, by environment."""
    figures: dict[str, Any] = json.loads((repository / "leaderboard" / "driving.json").read_text(encoding="utf-8"))
    return figures


@pytest.fixture(scope="module")
def results(repository: Path) -> Tables:
    found = list(tables(repository / "leaderboard" / "RESULTS.md"))
    assert len(found) == 9
    return found


def test_tracking_free(results: Tables) -> None:
    """Better on nuScenes and on simulated traffic, worse on mini and for people, level on KITTI."""
    rows = results[0]
    everywhere = of_envs(rows, ALL)
    assert below(rows, ALL) == NUSCENES | SIMULATED
    assert all(below(rows, key) >= NUSCENES for key in (IDS, REACQUIRED))
    assert (everywhere["nuScenes-mini"].ends or (0.0,))[0] > 0
    assert everywhere["KITTI"].level
    for key in COLUMNS:
        found = {name: each for name, each in of_envs(rows, key).items() if name in PEOPLE}
        assert all(each.value > 0 for each in found.values())
        worse = {name for name, each in found.items() if each.ends and each.ends[0] > 0}
        assert worse == ({"ETH-UCY"} if key == IDS else set())


def test_training_data(results: Tables) -> None:
    """Hypotheses add nothing significant to a network of a tracker's tracks; the other differences are gains."""
    assert len(results[1]) == 6
    for row in results[1]:
        tracklets = row["difference"].startswith("`mtp_modes_tracklets`")
        assert all(cell(row, key).level if tracklets else cell(row, key).below for key in COLUMNS)


def test_hypotheses(results: Tables) -> None:
    """Gains on identity switches; over all targets none for people, and the samples alone gain more."""
    rows = results[2]
    assert below(rows, IDS) == NUSCENES | {"nuScenes-mini", "ETH-UCY", "Intersection", "IntersectionRaw"}
    beyond = of_envs(rows, ALL)
    assert all(beyond[name].value > 0 for name in PEOPLE & beyond.keys())
    for name, each in of_envs(results[3], ALL).items():
        assert each.below
        assert each.value < 2 * beyond[name].value


def test_association_and_faults(results: Tables) -> None:
    """Association costs nothing significant at the Roundabout; the detector has nearly always the largest share."""
    assert of_envs(results[4], f"association alone, {IDS}")["Roundabout"].level
    shares = {(env(row), row["agent"]): {key: cell(row, key).value for key in list(row)[4:]} for row in results[5]}
    largest = 0
    for (name, agent), parts in shares.items():
        assert parts["detector"] > 50 or name not in {"nuScenes", "Intersection"}, (name, agent)
        largest += max(parts, key=lambda part: parts[part]) == "detector"
    assert len(shares) - largest == 1
    pets = {agent: parts for (name, agent), parts in shares.items() if name == "PETS"}
    assert [agent for agent, parts in pets.items() if parts["confidence"] > parts["detector"]] == ["`mtp`"]


def test_paper(results: Tables) -> None:
    """The paper's factors are larger; both gains of its second table go significantly beyond the samples."""

    def factors(key: str) -> list[float]:
        return [1 / (1 + cell(row, key).value / 100) for row in results[8] if row["table"] == "I"]

    assert {round(factor) for factor in factors("here")} <= {2, 3}
    assert round(max(factors("here, with PTP"))) == 4
    assert (round(min(factors("paper"))), round(max(factors("paper")))) == (9, 25)
    second = [row for row in results[8] if (row["table"], env(row)) == ("II", "nuScenes")]
    assert all(cell(row, key).below for row in second for key in ("bADE beyond the samples (m)", "bADE with PTP (m)"))
    assert [round(cell(row, "here, with PTP").value, -1) for row in second] == [-10, 0]


def test_driving(drives: dict[str, Any]) -> None:
    """Hypotheses drive no better than as many samples of one; networks of a tracker's tracks are with the best."""
    control = {("mtp", "stp_same_samples"), ("perfect_association_same_samples", "stp_same_samples")}
    for name, measured in drives.items():
        pairs = {(pair["one"], pair["other"]): pair["interval"] for pair in measured["pairs"]}
        assert len(control & set(pairs)) == (1 if "10Hz" in name else 2)
        assert all(pairs[pair][0] <= 0 for pair in control & set(pairs))
    for road in ("Intersection", "Roundabout", "Merge"):
        found = drives[f"MTP-Drive-{road}-v0"]
        scores = {name: row["drive_score"] for name, row in found["rows"].items()}
        best = max(score for name, score in scores.items() if not name.startswith(("gt_tracks", "perfect_")))
        assert all(best - scores[name] < 0.01 for name in ("stp_modes_tracklets", "mtp_modes_tracklets"))
        assert (best - scores["tracking_free"] < 0.01) == (road != "Merge")
        assert all(row["difference"] < 0 for name, row in found["attacks"].items() if name != "stp")
        measures = found["tau"]["without references"]["measures"]
        whole, near = measures["bADE"], measures["bADE near the ego"]
        assert whole["tau"] < near["tau"]
        assert near["low"] < whole["high"], "the intervals overlap"


def test_costs_of_a_switch(drives: dict[str, Any]) -> None:
    """Intervals that leave out 0, as the page on driving counts them."""
    costs = {
        (env, part, name.partition(",")[0]): (cost["low"], cost["high"])
        for env, made in drives.items()
        for part in ("windows", "ahead")
        for name, cost in made["switches"][part].items()
        if name.endswith("no switch before it")
    }
    assert len(costs) == 40
    assert {each: low > 0 for each, (low, high) in costs.items() if not low <= 0 <= high} == {
        ("MTP-Drive-Merge-v0", "windows", "hard brake"): True,
        ("MTP-Drive-Roundabout-v0", "ahead", "phantom brake"): False,
    }


SIGNS = {  # of differences of driving at intersection, roundabout and merge: 0 where the interval holds 0
    "`stp` − `gt_tracks`": [-1, -1, -1], "`perfect_association` − `stp`": [0, 0, 0],
    "`stp_same_samples` − `stp`": [1, 0, 0], "`mtp` − `stp_same_samples`": [0, 0, 0],
    "`perfect_association_same_samples` − `stp_same_samples`": [0, 0, 0], "`stp_modes_tracklets` − `stp`": [1, 1, 1],
    "`stp_modes_tracklets` − `stp_modes`": [1, 1, 1], "`tracking_free` − `stp_modes_tracklets`": [0, 0, -1],
    "`tracking_free` − `mtp_modes_tracklets`": [0, 0, 0],
}  # fmt: skip


def test_differences_of_driving(repository: Path) -> None:
    page = repository / "docs" / "environment" / "driving_results.md"
    (block,) = re.findall(r"<!-- driving: in short -->(.*?)<!-- /driving -->", page.read_text("utf-8"), re.DOTALL)
    lines = [[part.strip() for part in line.strip("|").split("|")] for line in block.strip().splitlines()[4:]]
    signs = {}
    for name, *cells in lines:
        ends = [cell({"": each}, "").ends for each in cells[:3]]
        signs[name] = [(low > 0) - (high < 0) for low, high in filter(None, ends)]
    assert signs | SIGNS == signs


def test_readme(repository: Path) -> None:
    """`tracking_free` is ahead of all ranked agents on both errors, of `gt_tracks` on one, and by the energy score."""
    (rows,) = tables(repository / "README.md")
    of_agents = {row["agent"].strip("`"): row for row in rows}
    switch, everywhere, energy = (
        {agent: cell(row, f"{key} (m) ↓").value for agent, row in of_agents.items()}
        for key in ("identity switch", "all targets", "energy score")
    )
    assert switch["tracking_free"] < switch["gt_tracks"]
    assert min(everywhere, key=lambda agent: (agent == "gt_tracks", everywhere[agent])) == "tracking_free"
    assert min(energy, key=lambda agent: energy[agent]) == "tracking_free"


def test_what_identity_switches_weigh(repository: Path) -> None:
    """Shares of runs add up; on mini only those without a score threshold have a significant gain."""
    weights = (repository / "envs" / "reference" / "README.md").read_text(encoding="utf-8")
    lines = [[part.strip() for part in line.strip("|").split("|")] for line in weights.splitlines()]
    keys = ["environment", "threshold", "ids share", "ids", "reacquired share", "reacquired"]
    rows = [dict(zip(keys, line, strict=True)) for line in lines if line[0] in ("mini", "Intersection")]
    for name in {row["environment"] for row in rows}:
        of_env = [row for row in rows if row["environment"] == name]
        assert [row["threshold"] for row in of_env] == ["none", "10 % quantile", "25 % quantile"]
        for key in ("ids share", "reacquired share"):
            assert sum(cell(row, key).value for row in of_env) == pytest.approx(100, abs=0.16)
    assert [cell(row, "ids").below for row in rows if row["environment"] == "mini"] == [True, False, False]


def test_low_coverage_is_listed(repository: Path) -> None:
    """The second table of coverage lists what the first has below 93 % at six effective units or more."""
    text = (repository / "docs" / "definitions" / "checks.md").read_text(encoding="utf-8")
    section = text.partition("## Ranks and intervals under resampling")[2].partition("\n## ")[0]
    lines = [[part.strip() for part in line.strip("|").split("|")] for line in section.splitlines() if line[:1] == "|"]
    heading, _, *measured = [line for line in lines if len(line) == 10]
    units = [number.removesuffix(" units") for number in heading[3:]]
    expected: dict[tuple[str, str], list[str]] = {}
    for of_error, of_difference in zip(measured[::2], measured[1::2], strict=True):
        effective = [float(NUMBER.findall(part)[-1]) for part in of_error[3:]]
        low = []
        for shares in (of_error[3:], of_difference[3:]):
            known = [float(share.split(" ")[0]) if share[0] != "–" else 100 for share in shares]
            below_promise = [
                count for count, share, size in zip(units, known, effective, strict=True) if share < 93 and size >= 6
            ]
            low.append(", ".join(below_promise) or "–")
        if low != ["–", "–"]:
            expected[of_error[0], of_error[1]] = low
    _, _, *listed = [line for line in lines if len(line) == 4]
    assert {(name, subset): low for name, subset, *low in listed} == expected
