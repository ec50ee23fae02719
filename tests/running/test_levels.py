"""Agents over the strength of an error of the detector."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mtp_bench
from mtp_bench import MtpBenchError, Scene, UnknownNameError
from mtp_bench.cards import load_card
from mtp_bench.core import to_text
from mtp_bench.running import RunOptions, compare, level_runs, load_run, run
from mtp_bench.running.detector_rows import detector_row
from mtp_bench.running.levels import LEVELS, Level, LevelRow, Robustness
from mtp_bench.scoring import Subset, numbers_of
from mtp_bench.sources import open_source
from mtp_bench.viz.studies.curves import draw_curves
from tests.support.command_line import CommandLine

ENV = "MTP-Intersection-v0"


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robustness, Path]:
    folder = tmp_path_factory.mktemp("levels")
    return mtp_bench.robustness(["mtp"], ENV, "noise", [1.0, 4.0], folder=folder, scenes=3), folder


def test_as_recorded_is_the_comparison(measured: tuple[Robustness, Path]) -> None:
    result, _ = measured
    report = compare(["mtp"], ENV, RunOptions(scenes=3)).report
    plain = {(row.agent, row.subset): row for row in report.rows if row.budget == "equal"}
    rows = [row for row in result.rows if row.level == 1]
    assert {row.agent for row in rows} == {
        "mtp", "stp", "stp_same_samples", "stp_neighbours", "perfect_association_same_samples"
    }  # fmt: skip
    for row in rows:
        if row.agent != "mtp":  # whose row of the comparison has another number of hypotheses
            same = plain[row.agent, row.subset]
            to_stp = numbers_of(result.difference(row, "stp"))
            assert (row.value, row.interval) == (same.error, same.interval)
            if row.agent != "stp":
                assert to_stp == (same.difference_to_stp, same.difference_interval, same.p)
    value = {(row.agent, row.subset): row.value for row in rows}
    for row in rows:
        for name in ("stp_same_samples", "stp_neighbours", "perfect_association_same_samples"):
            difference = result.difference(row, name)
            if row.agent == name:
                assert difference is None
            else:
                assert difference is not None
                assert difference.mean == pytest.approx(value[row.agent, row.subset] - value[name, row.subset])


def test_more_noise_costs_and_targets_stay(measured: tuple[Robustness, Path]) -> None:
    result, _ = measured
    value = {(row.agent, row.level): row.value for row in result.on("all")}
    for agent in ("stp", "mtp", "stp_same_samples"):
        assert value[agent, 4.0] > value[agent, 1.0] + 0.3
        row = next(row for row in result.on("all") if (row.agent, row.level) == (agent, 4.0))
        rise = result.difference(row, level=1.0)
        assert rise is not None
        assert rise.mean == pytest.approx(value[agent, 4.0] - value[agent, 1.0])
    assert len({tuple(row.weights) for row in result.on("all")}) == 1, "equal targets at all levels"
    less, more = (level.detector for level in result.levels)
    assert less is not None
    assert more is not None
    assert (more.error or 0) > 2 * (less.error or 0)
    assert less.error_memory == pytest.approx(more.error_memory, rel=0.1), "errors last as long as recorded"
    assert result.mean_relative["stp"] == 1
    assert result.mean_relative["mtp"] == pytest.approx(np.mean([value["mtp", x] / value["stp", x] for x in (1, 4)]))


def test_finished_levels_are_not_run_again(measured: tuple[Robustness, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    result, folder = measured
    assert sorted(path.name for path in folder.iterdir()) == ["noise-1.json", "noise-4.json"]

    def fail(*arguments: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(level_runs, "_scores", fail)
    assert mtp_bench.robustness(["mtp"], ENV, "noise", [1.0, 4.0], folder=folder, scenes=3) == result
    for changes in ({"scenes": 2}, {"seeds": [1]}, {"perturb": {"score": 0.3}}):
        options: Any = {"scenes": 3, **changes}
        with pytest.raises(AssertionError):
            mtp_bench.robustness(["mtp"], ENV, "noise", [1.0], folder=folder, **options)
    (folder / "noise-1.json").write_text("{}")
    with pytest.raises(MtpBenchError, match=r"noise-1\.json"):
        mtp_bench.robustness(["mtp"], ENV, "noise", [1.0], folder=folder, scenes=3)


UNITS = 12


def row(level: float, agent: str, value: float, subset: Subset = "all", spread: float = 0.0) -> LevelRow:
    """Units that are ``spread`` times 1 apart from ``value``, in turns above and below."""
    sums = value + spread * (np.arange(UNITS) % 2 * 2 - 1)
    return LevelRow(
        level=level, agent=agent, value=value, subset=subset, interval=None, sums=sums.tolist(), weights=[1.0] * UNITS
    )


def made(*rows: LevelRow, is_drive: bool = False) -> Robustness:
    at = sorted({each.level for each in rows})
    each_level = [Level(key="", detector=None, rows=[each for each in rows if each.level == level]) for level in at]
    several = () if is_drive else ("mtp",)
    return Robustness("MTP-KITTI-v0", "noise", ("mtp", "tracking_free"), several, tuple(each_level), is_drive)


def test_the_answer_says_where_the_order_changes() -> None:
    rows = []
    for level, free, spread in ((0.0, 3.0, 1.0), (1.0, 2.4, 1.0), (2.0, 2.0, 0.01)):
        rows += [
            row(level, "mtp", 2.5), row(level, "stp", 2.8), row(level, "tracking_free", free, spread=spread),
            row(level, "stp_neighbours", 0.1),  # a control that nobody asked for
        ]  # fmt: skip
    assert made(*rows).answer == (
        "Lowest bADE by noise: mtp at 0 (before the next with p < 0.05 at 0), then tracking_free at 1 and 2 (before "
        "the next with p < 0.05 at 2). On identity switches mtp gains beyond same samples and neighbours (p < 0.05) "
        "at no level."
    )
    driven = made(*rows, is_drive=True).answer
    assert driven.startswith("Highest drive score by noise: tracking_free at 0, then stp at 1 and 2 (before")


def test_a_drive_score_of_0_has_no_ratio() -> None:
    result = made(row(1.0, "stp", 0.0), row(1.0, "mtp", 0.5), row(2.0, "stp", 0.5), row(2.0, "mtp", 1.0), is_drive=True)
    assert result.mean_relative == {"stp": 1.0, "mtp": 2.0}


def test_an_object_is_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No file tells whether it is the one of the stored level."""
    asked: dict[str, Any] = {"folder": tmp_path, "scenes": 1}
    agent = mtp_bench.load_submission("stp").build
    mtp_bench.robustness([agent], ENV, "noise", [1.0], **asked)
    monkeypatch.setattr(level_runs, "_scores", lambda *_: [])
    with pytest.raises(MtpBenchError, match="have no targets"):
        mtp_bench.robustness([agent], ENV, "noise", [1.0], **asked)


GAINS = [(2.3, 2.2, 0.0, True), (2.3, 2.2, 1.0, False), (2.3, 1.9, 0.0, False), (1.9, 2.2, 0.0, False)]


@pytest.mark.parametrize(("same", "neighbours", "spread", "is_gain"), GAINS)
def test_a_gain_of_hypotheses_exceeds_both_controls(
    same: float, neighbours: float, spread: float, is_gain: bool
) -> None:
    rows = [row(1.0, "mtp", 2.0), row(1.0, "stp", 2.5), row(1.0, "mtp", 2.0, "ids")]
    rows += [row(1.0, "stp_same_samples", same, "ids", spread), row(1.0, "stp_neighbours", neighbours, "ids", spread)]
    where = "1" if is_gain else "no level"
    assert made(*rows).answer.endswith(
        f"On identity switches mtp gains beyond same samples and neighbours (p < 0.05) at {where}."
    )


def test_tables_frame_and_file(measured: tuple[Robustness, Path]) -> None:
    result, _ = measured
    first, second, detector = result.tables
    assert first.title == f"{ENV}, noise: all targets"
    assert len(first.rows) == len(second.rows) == 10
    assert len(detector.rows) == 2
    frame = result.to_frame()
    assert len(frame) == 20
    assert set(frame["subset"]) == {"all", "ids"}
    assert not frame.duplicated(["level", "agent", "subset"]).any()
    assert "subset" not in to_text(first)
    assert {"level", "agent", "value", "to_stp", "to_same_samples_interval", "to_recorded_p"} <= set(frame.columns)
    content = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert content["answer"] == str(result) == result.answer
    assert "to stp" in to_text(first)


@pytest.mark.parametrize("name", ["a.svg", "a.png", "a.pdf"])
def test_curves_are_drawn(name: str, measured: tuple[Robustness, Path], tmp_path: Path) -> None:
    result, _ = measured
    for dark in (False, True):
        draw_curves([result, result], tmp_path / name, dark=dark)
        assert (tmp_path / name).stat().st_size > 5000
    if name.endswith("svg"):
        drawn = (tmp_path / name).read_text(encoding="utf-8")
        assert "bADE, m, less stp" in drawn
        assert drawn.count("perfect_association_same_samples") >= 1


def test_the_command(cli: CommandLine, tmp_path: Path) -> None:
    words = ("robustness", "stp", "--env", ENV, "--scenes", 1, "--jobs", 1, "--knob", "score", "--levels", "0,0.5")
    out = cli.ok(*words, "--plot", tmp_path / "a.svg", "--table", tmp_path / "a.csv", "-o", tmp_path / "levels")
    assert "Lowest bADE by score: stp at 0 and 0.5" in " ".join(out.split())
    assert (tmp_path / "a.csv").read_text().startswith("level,agent,value")
    assert json.loads(cli.ok(*words, "-o", tmp_path / "levels", "--json", "-"))["knob"] == "score"
    assert cli("robustness", "stp", "--env", ENV, "--knob", "scor").status == 2
    assert "expected numbers such as" in cli(*words[:-1], "0,x").err
    assert "perturb" in cli("run", "stp", "--env", ENV, "--perturb", "noise=-2", "-o", tmp_path / "run").error
    assert cli("run", "stp", "--env", ENV, "--perturb", "noise", "-o", tmp_path / "run").status == 2


def test_a_stored_run_keeps_its_condition(cli: CommandLine, tmp_path: Path) -> None:
    where = ("--env", ENV, "--scenes", 1, "--jobs", 1)
    cli.ok("run", "stp", *where, "--perturb", "noise=2, misses=3", "-o", tmp_path / "run")
    assert load_run(tmp_path / "run").info.keywords["perturb"] == {"noise": 2, "misses": 3}
    run("stp", ENV, tmp_path / "same", scenes=1, perturb={"noise": 2.0, "misses": 3.0})
    errors = [mtp_bench.score(tmp_path / name).report.rows[0].error for name in ("run", "same")]
    assert errors[0] == errors[1] != mtp_bench.evaluate("stp", ENV, scenes=1).rows[0].error
    assert "changed" in cli.ok("score", tmp_path / "run")


def test_wrong_questions() -> None:
    with pytest.raises(UnknownNameError, match="knob"):
        mtp_bench.robustness(["stp"], ENV, "nois")
    with pytest.raises(MtpBenchError, match="expected a list"):
        mtp_bench.robustness("stp", ENV, "noise")
    with pytest.raises(MtpBenchError, match="no level of noise, expected at least one"):
        mtp_bench.robustness(["stp"], ENV, "noise", [])
    assert set(LEVELS) == {"score", "misses", "false", "noise", "delay"}


@pytest.mark.parametrize("level", [17.0, float("nan"), "2", None])
def test_a_wrong_level_is_an_error_before_any_is_run(level: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(level_runs, "_level", lambda *_: pytest.fail("a level was run"))
    with pytest.raises(MtpBenchError, match="perturb: noise"):
        mtp_bench.robustness(["stp"], ENV, "noise", [1.0, level], scenes=1)


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Names of the agents of each level that would be run."""
    names: list[list[str]] = []

    def note(settings: Any, evaluation: Any, level: float, _: object) -> Level:
        names.append([f"{level:g}", *(setting.label for setting in settings)])
        return Level(key="", detector=None, rows=[row(level, "stp", 1.0)])

    monkeypatch.setattr(level_runs, "_level", note)
    return names


def test_levels_and_agents_come_once_and_in_order(named: list[list[str]]) -> None:
    result = mtp_bench.robustness(["mtp", "mtp", "stp"], ENV, "noise", [4.0, 1, 1.0], scenes=1)
    assert result.agents == ("mtp", "stp")
    assert result.several == ("mtp",)
    assert [first for first, *_ in named] == ["1", "4"]
    assert named[0].count("stp") == named[0].count("mtp") == 1


def test_a_closed_loop_says_nothing_of_controls_that_are_not_run(named: list[list[str]]) -> None:
    result = mtp_bench.robustness(["mtp"], "MTP-Drive-Intersection-v0", "noise", [1.0], scenes=1)
    assert "identity switches" not in result.answer
    assert "stp_same_samples" not in named[0]


def test_two_submissions_of_one_name(tmp_path: Path) -> None:
    """Else one has the numbers of the other, or stands in for the control."""
    folder = tmp_path / "stp"
    shutil.copytree(Path("baselines/stp"), folder)
    with pytest.raises(MtpBenchError, match="two submissions are called 'stp'"):
        mtp_bench.robustness([str(folder)], ENV, "noise", [1.0], scenes=1)


def test_memory_of_errors_and_misses() -> None:
    """Errors that an object keeps correlate, errors drawn anew do not."""
    card = load_card(ENV)
    source = open_source(card)
    scene = source.load(source.names[0])
    truth = scene.truth
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(truth.object_id.max() + 1, 2)) * 0.3
    kept = offsets[truth.object_id]
    anew = rng.normal(size=kept.shape) * 0.3

    def seen(offset: Any) -> Scene:
        box = truth.box.copy()
        box[:, :2] += offset
        detections = replace(
            scene.detections, start=truth.start, box=box, velocity=np.zeros((len(box), 2)), class_id=truth.class_id,
            score=np.ones(len(box)),
        )  # fmt: skip
        return replace(scene, detections=detections)

    lasting, fresh = (detector_row([seen(offset)], card, 1.0) for offset in (kept, anew))
    assert (lasting.error_memory or 0) > 0.95
    assert abs(fresh.error_memory or 0) < 0.2
    assert lasting.missed is not None
    assert lasting.missed < 0.05
    assert lasting.false < 0.5


def test_the_time_of_an_agent_is_a_delay_in_whole_frames(
    cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 2 Hz, 600 ms are one whole frame; what is stored repeats it."""
    report = mtp_bench.evaluate("stp", ENV, scenes=1)
    slow = replace(report, rows=[each.model_copy(update={"ms_per_frame": 600.0}) for each in report.rows])
    monkeypatch.setattr(level_runs, "evaluate", lambda *_: slow)
    where = ("--env", ENV, "--scenes", 1, "--jobs", 1)
    out = cli.ok("run", "stp", *where, "--delay", "measured", "-o", tmp_path / "late")
    assert "stp takes the time of 1 whole frames: --perturb delay=1" in " ".join(out.split())
    assert load_run(tmp_path / "late").info.keywords["perturb"] == {"delay": 1}
    cli.ok("run", "stp", *where, "--perturb", "delay=1", "-o", tmp_path / "same")
    digests = [[each.forecast.tobytes() for each in load_run(tmp_path / name).rollouts] for name in ("late", "same")]
    assert digests[0] == digests[1]
    monkeypatch.undo()
    assert level_runs.measured_delay("stp", ENV, RunOptions()) == 0, "some milliseconds"


def test_fewer_errors_lie_between_perfect_detections_and_the_recorded_ones() -> None:
    fewer = {"misses": 0.0, "noise": 0.0}
    conditions: list[dict[str, float] | None] = [{**fewer, "false": 0.0}, fewer, None]
    errors = [mtp_bench.evaluate("stp", ENV, scenes=3, perturb=levels).rows[0].error or 0 for levels in conditions]
    assert errors == sorted(errors)
    assert errors[2] > errors[0] + 0.3
