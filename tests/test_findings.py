"""Sentences of README and RESULTS.md, against the tables that stand beside them: those are made of records."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest

BLOCK = re.compile(r"<!-- table: [^>]*-->\n\n(.*?)\n\n<!-- /table -->", re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
ALL, IDS, REACQUIRED = "all targets (m)", "identity switch (m)", "reacquired (m)"
NUSCENES = {"nuScenes", "nuScenes-CenterPoint"}
JUNCTIONS = {"Intersection", "IntersectionRaw", "Roundabout"}
SIMULATED = {*JUNCTIONS, "Highway", "Merge"}
PEOPLE = {"WILDTRACK", "PETS", "ETH-UCY"}

Row = Mapping[str, str]


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
def leaderboard(repository: Path) -> Path:
    return repository / "leaderboard"


@pytest.fixture(scope="module")
def page(leaderboard: Path) -> str:
    return " ".join((leaderboard / "RESULTS.md").read_text(encoding="utf-8").split())


@pytest.fixture(scope="module")
def drives(leaderboard: Path) -> dict[str, Any]:
    """Figures of the study of driving, by environment."""
    figures: dict[str, Any] = json.loads((leaderboard / "driving.json").read_text(encoding="utf-8"))
    return figures


@pytest.fixture(scope="module")
def driving_page(repository: Path) -> str:
    path = repository / "docs" / "environment" / "driving_results.md"
    return " ".join(path.read_text(encoding="utf-8").split())


@pytest.fixture(scope="module")
def results(leaderboard: Path) -> list[list[dict[str, str]]]:
    found = list(tables(leaderboard / "RESULTS.md"))
    assert len(found) == 9
    return found


def test_tracking_free(page: str, results: list[list[dict[str, str]]]) -> None:
    rows = results[0]
    assert "On nuScenes it is better in each column, with both detectors, and over all targets on all simulated" in page
    assert below(rows, ALL) == NUSCENES | SIMULATED
    assert below(rows, IDS) >= NUSCENES
    assert below(rows, REACQUIRED) >= NUSCENES
    everywhere = of_envs(rows, ALL)
    assert "it is worse over all targets; on KITTI the two are level." in page
    assert (everywhere["nuScenes-mini"].ends or (0.0,))[0] > 0
    assert everywhere["KITTI"].level
    assert "For people it is worse throughout, significantly on identity switches of ETH/UCY" in page
    for key in (ALL, IDS, REACQUIRED):
        found = {name: each for name, each in of_envs(rows, key).items() if name in PEOPLE}
        assert all(each.value > 0 for each in found.values())
        worse = {name for name, each in found.items() if each.ends and each.ends[0] > 0}
        assert worse == ({"ETH-UCY"} if key == IDS else set())


def test_training_data(page: str, results: list[list[dict[str, str]]]) -> None:
    assert "At both, hypotheses add nothing significant to a network of a tracker's tracks; to one of" in page
    assert len(results[1]) == 6
    for row in results[1]:
        tracklets = row["difference"].startswith("`mtp_modes_tracklets`")
        assert all(cell(row, key).level if tracklets else cell(row, key).below for key in (ALL, IDS, REACQUIRED))


def test_hypotheses(page: str, results: list[list[dict[str, str]]]) -> None:
    rows = results[2]
    assert (
        "On identity switches the gain is significant on nuScenes with both detectors, on mini, on ETH/UCY and at both"
        " Intersections, but not at the Roundabout." in page
    )
    assert below(rows, IDS) == NUSCENES | {"nuScenes-mini", "ETH-UCY", "Intersection", "IntersectionRaw"}
    most = max(-each.value for each in of_envs(rows, ALL).values())
    assert f"Over all targets it is at most {most:.2f} m, often insignificant, and none for people." in page
    assert {name for name, each in of_envs(rows, ALL).items() if name in PEOPLE and each.value <= 0} == set()


def test_samples(results: list[list[dict[str, str]]]) -> None:
    """Heading 4: over all targets the samples alone gain more than hypotheses do beyond them."""
    beyond = of_envs(results[2], ALL)
    for name, each in of_envs(results[3], ALL).items():
        assert each.below
        assert each.value < 2 * beyond[name].value


def test_association(page: str, results: list[list[dict[str, str]]]) -> None:
    alone, rows = "association alone, ", results[4]
    where = {*NUSCENES, "nuScenes-mini", "Intersection", "IntersectionRaw"}
    switches, everywhere = of_envs(rows, alone + IDS), of_envs(rows, alone + ALL)
    low, high = (end(switches[name].value for name in where) for end in (min, max))
    least, most = (end(everywhere[name].value for name in where) for end in (min, max))
    people = f"on ETH/UCY {switches['ETH-UCY'].value:.2f} and {everywhere['ETH-UCY'].value:.2f} m"
    costs = f"association costs {low:.1f} to {high:.1f} m on identity switches and {least:.2f} to {most:.2f} m over all"
    assert f"On nuScenes, mini and at both Intersections {costs} targets, {people}, and at the Roundabout" in page
    assert switches["Roundabout"].level


def test_faults(page: str, results: list[list[dict[str, str]]]) -> None:
    shares = {(env(row), row["agent"]): {key: cell(row, key).value for key in list(row)[4:]} for row in results[5]}
    assert "The detector has more than half of it on nuScenes and at the Intersection" in page
    largest = 0
    for (name, agent), parts in shares.items():
        assert parts["detector"] > 50 or name not in {"nuScenes", "Intersection"}, (name, agent)
        largest += max(parts, key=lambda part: parts[part]) == "detector"
    assert len(shares) - largest == 1, "nearly always"
    assert "On PETS its share is localisation and history, and confidence costs about as much, for `mtp` more." in page
    pets = {agent: parts for (name, agent), parts in shares.items() if name == "PETS"}
    assert [agent for agent, parts in pets.items() if parts["confidence"] > parts["detector"]] == ["`mtp`"]


def test_driving(page: str, drives: dict[str, Any]) -> None:
    assert "Hypotheses drive no better than as many samples from one. At 2 Hz perfect association does not" in page
    control = {("mtp", "stp_same_samples"), ("perfect_association_same_samples", "stp_same_samples")}
    for name, measured in drives.items():
        pairs = {(pair["one"], pair["other"]): pair["interval"] for pair in measured["pairs"]}
        assert len(control & set(pairs)) == (1 if "10Hz" in name else 2)
        assert all(pairs[pair][0] <= 0 for pair in control & set(pairs))
    scores = {
        road: {name: row["drive_score"] for name, row in drives[f"MTP-Drive-{road}-v0"]["rows"].items()}
        for road in ("Intersection", "Roundabout", "Merge")
    }
    assert "with a network ground-truth tracks reach 0.94 to 0.95." in page
    assert {f"{found['gt_tracks_modes']:.2f}" for found in scores.values()} == {"0.94", "0.95"}
    assert "drive best or level with the best that sees no truth; `tracking_free` too, but at the merge" in page
    for found in scores.values():
        honest = {name: score for name, score in found.items() if not name.startswith(("gt_tracks", "perfect_"))}
        best = max(honest.values())
        assert all(best - honest[name] < 0.01 for name in ("stp_modes_tracklets", "mtp_modes_tracklets"))
        assert (best - honest["tracking_free"] < 0.01) == (found is not scores["Merge"])
    pairs = {(pair["one"], pair["other"]): pair for pair in drives["MTP-Drive-Merge-v0"]["pairs"]}
    behind = pairs["tracking_free", "stp_modes_tracklets"]
    low, high = sorted(-end for end in behind["interval"])
    assert f"where `stp_modes_tracklets` is {-behind['mean']:.3f} [{low:.3f}, {high:.3f}] better." in page


def test_driving_page(driving_page: str, drives: dict[str, Any]) -> None:
    """What the page says in words, against its figures."""
    roads = [drives[f"MTP-Drive-{road}-v0"] for road in ("Intersection", "Roundabout", "Merge")]
    rows = [road["rows"] for road in roads]
    braked = [own["stp"]["phantom_brakes"] / own["gt_tracks"]["phantom_brakes"] for own in rows]
    assert "It brakes hard on a free way eleven, two and three times as often." in driving_page
    assert [round(times) for times in braked] == [11, 2, 3]
    crashes = {
        name: [round(2 * own[name]["collisions"]) for own in rows] for name in ("gt_tracks", "blind", "standing")
    }
    assert "the ego has 0, 0 and 1 collisions at fault in the 200 scenes" in driving_page
    assert "without any object it has 91, 117 and 97, and with objects that stand still 4, 3 and 23." in driving_page
    assert crashes == {"gt_tracks": [0, 0, 1], "blind": [91, 117, 97], "standing": [4, 3, 23]}
    fast = drives["MTP-Drive-Intersection-10Hz-v0"]["rows"]
    assert "with `stp` there are 6 collisions at fault in 200 drives, and with ground-truth tracks none" in driving_page
    assert [2 * fast[name]["collisions"] for name in ("stp", "gt_tracks")] == [6, 0]
    assert (
        "lower than between two halves of the scenes at the intersection and the roundabout, and higher at"
        in driving_page
    )
    taus = [road["tau"]["without references"] for road in roads]
    assert [each["measures"]["bADE"]["tau"] < each["between halves"] for each in taus] == [True, True, False]
    better, tested = ("mtp_modes_tracklets", "stp_modes_tracklets", "tracking_free"), roads[2]["rows"]
    six = (*better, "affinity", "mtp", "stp_same_samples")
    assert "only `mtp_modes_tracklets`, `stp_modes_tracklets` and `tracking_free` are: at the merge" in driving_page
    assert [tested[name]["p"] < 0.05 for name in six] == [True, True, True, False, False, False]
    attacks = [row for road in roads for name, row in road["attacks"].items() if name != "stp"]
    seen = [row["seen"]["50"] for row in attacks]
    assert f"differences of {min(seen):.2f} to {max(seen):.2f}, no dishonest agent drives better" in driving_page
    assert all(row["difference"] < 0 for row in attacks)
    for road in roads:
        all_targets, near = (
            road["tau"]["without references"]["measures"][key] for key in ("bADE", "bADE near the ego")
        )
        assert all_targets["tau"] < near["tau"]
        assert near["low"] < all_targets["high"], "the intervals overlap"


def test_costs_of_a_switch(driving_page: str, drives: dict[str, Any]) -> None:
    """Intervals that leave out 0, as the page on driving counts them."""
    costs = {
        (env, part, name.partition(",")[0]): (cost["low"], cost["high"])
        for env, made in drives.items()
        for part in ("windows", "ahead")
        for name, cost in made["switches"][part].items()
        if name.endswith("no switch before it")
    }
    assert "Of forty such intervals two leave out 0" in driving_page
    assert len(costs) == 40
    assert {each: low > 0 for each, (low, high) in costs.items() if not low <= 0 <= high} == {
        ("MTP-Drive-Merge-v0", "windows", "hard brake"): True,
        ("MTP-Drive-Roundabout-v0", "ahead", "phantom brake"): False,
    }


def test_differences_of_driving(repository: Path) -> None:
    """Signs of the differences in the first table, intersection, roundabout and merge: 0 where the interval holds 0."""
    page = repository / "docs" / "environment" / "driving_results.md"
    (block,) = re.findall(r"<!-- driving: in short -->(.*?)<!-- /driving -->", page.read_text("utf-8"), re.DOTALL)
    lines = [[part.strip() for part in line.strip("|").split("|")] for line in block.strip().splitlines()[4:]]
    signs = {}
    for name, *cells in lines:
        ends = [cell({"": each}, "").ends for each in cells[:3]]
        signs[name] = [(low > 0) - (high < 0) for low, high in filter(None, ends)]
    assert signs["`stp` − `gt_tracks`"] == [-1, -1, -1], "driving suffers"
    assert signs["`perfect_association` − `stp`"] == [0, 0, 0], "wins nothing significant back"
    assert signs["`stp_same_samples` − `stp`"] == [1, 0, 0], "at the intersection"
    assert signs["`mtp` − `stp_same_samples`"] == [0, 0, 0], "drives as well"
    assert signs["`perfect_association_same_samples` − `stp_same_samples`"] == [0, 0, 0], "drives as well"
    assert signs["`stp_modes_tracklets` − `stp`"] == [1, 1, 1], "counts most"
    assert signs["`stp_modes_tracklets` − `stp_modes`"] == [1, 1, 1], "worse than it everywhere"
    assert signs["`tracking_free` − `stp_modes_tracklets`"] == [0, 0, -1], "better at the merge"
    assert signs["`tracking_free` − `mtp_modes_tracklets`"] == [0, 0, 0], "not significantly"


def test_paper(page: str, results: list[list[dict[str, str]]]) -> None:
    def factors(key: str) -> list[float]:
        return [1 / (1 + cell(row, key).value / 100) for row in results[8] if row["table"] == "I"]

    assert "two to three times here, with PTP up to four times. The paper's factors are 9 to 25," in page
    assert {round(factor) for factor in factors("here")} <= {2, 3}
    assert round(max(factors("here, with PTP"))) == 4
    assert (round(min(factors("paper"))), round(max(factors("paper")))) == (9, 25)
    second = {row["targets"]: row for row in results[8] if (row["table"], env(row)) == ("II", "nuScenes")}
    assert "On nuScenes both gains go significantly beyond the samples." in page
    assert all(cell(row, "bADE beyond the samples (m)").below for row in second.values())
    assert "by minADE a tenth and nothing, by bADE both significant." in page
    assert [round(cell(row, "here, with PTP").value, -1) for row in second.values()] == [-10, 0]
    assert all(cell(row, "bADE with PTP (m)").below for row in second.values())


def test_readme(repository: Path) -> None:
    """What association costs, what hypotheses win back, and who leads; `test_leaderboard` has the intervals."""
    text = " ".join((repository / "README.md").read_text(encoding="utf-8").split())
    (rows,) = tables(repository / "README.md")
    switch = {row["agent"].strip("`"): cell(row, "identity switch (m) ↓").value for row in rows}
    everywhere = {row["agent"].strip("`"): cell(row, "all targets (m) ↓").value for row in rows}
    energy = {row["agent"].strip("`"): cell(row, "energy score (m) ↓").value for row in rows}
    cost = switch["stp_same_samples"] - switch["perfect_association_same_samples"]
    won = switch["stp_same_samples"] - switch["mtp"]
    weights = " ".join((repository / "envs" / "reference" / "README.md").read_text(encoding="utf-8").split())
    (unused,) = re.findall(r"\(which was trained on them\): (\S+) m \[.*?There hypotheses win (\S+) m \[", weights)
    assert f"wrong association costs {cost:.2f} to {unused[0]} m where identities switch." in text
    assert f"Hypotheses win {won:.2f} to {unused[1]} m of it back, with as many samples." in text
    assert "also better than `gt_tracks`, which is constant velocity" in text
    assert switch["tracking_free"] < switch["gt_tracks"]
    assert min(everywhere, key=lambda agent: (agent == "gt_tracks", everywhere[agent])) == "tracking_free"
    assert "is ahead of all ranked agents on both; its energy score is the lowest." in text
    assert min(energy, key=lambda agent: energy[agent]) == "tracking_free"


def test_what_identity_switches_weigh(repository: Path, page: str) -> None:
    """Sentences on the share of runs without a score threshold, against its table, which was measured once."""
    weights = (repository / "envs" / "reference" / "README.md").read_text(encoding="utf-8")
    lines = [[part.strip() for part in line.strip("|").split("|")] for line in weights.splitlines()]
    keys = ["environment", "threshold", "ids share", "ids", "reacquired share", "reacquired"]
    rows = [dict(zip(keys, line, strict=True)) for line in lines if line[0] in ("mini", "Intersection")]
    for name in {row["environment"] for row in rows}:
        of_env = [row for row in rows if row["environment"] == name]
        assert [row["threshold"] for row in of_env] == ["none", "10 % quantile", "25 % quantile"]
        for key in ("ids share", "reacquired share"):
            assert sum(cell(row, key).value for row in of_env) == pytest.approx(100, abs=0.16)
    mini = [row for row in rows if row["environment"] == "mini"]
    share = f"{cell(mini[0], 'ids share').value:.0f} %"
    assert [cell(row, "ids").below for row in mini] == [True, False, False], "only there is the gain significant"
    readme = " ".join((repository / "README.md").read_text(encoding="utf-8").split())
    for text in (page, readme):
        assert f"On mini [{share} of the weight](" in text
        assert "reference trackers without a score threshold, and only there is the gain significant." in text
    (unused,) = re.findall(r"\(which was trained on them\): (\S+ m) (\[\S+ \S+\])\.", " ".join(weights.split()))
    assert f"([{unused[0]}](envs/reference/README.md#what-identity-switches-weigh) on unused training scenes)" in readme
    cost_text = " ".join(unused)
    assert f"that nothing was fitted to, with Megvii's detections too, it was {cost_text} on identity switches." in page
    columns = (repository / "mtp_bench" / "viz" / "board" / "columns.toml").read_text(encoding="utf-8")
    definitions = (repository / "docs" / "definitions" / "index.md").read_text(encoding="utf-8")
    assert f"nuScenes mini {share} of the weight comes from the third of its runs" in columns
    assert f"most of the weight of `ids`: {share} on nuScenes mini" in definitions


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
