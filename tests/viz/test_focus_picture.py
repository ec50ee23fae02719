"""Pictures of events: what a person sees is there, and in its place; of small scenes and of real recordings."""

import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from mtp_bench.viz import palette
from mtp_bench.viz.causes import sentence
from mtp_bench.viz.drawing.birds_eye import PANEL, draw_frame
from mtp_bench.viz.drawing.close_up import OBJECT, draw_focus
from mtp_bench.viz.drawing.column import Mark, column
from mtp_bench.viz.drawing.report import COLUMN, ROW, SIZE, picture, report, save_report
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.framing import Window, window_of
from mtp_bench.viz.palette import ROLES
from mtp_bench.viz.run_replay import Replay
from mtp_bench.viz.terminal.event_table import Listed, in_order
from tests.support.command_line import CommandLine
from tests.support.focus_scenes import EVENT, MOST_BRIGHT, crowd

Picture = NDArray[np.uint8]


def near(image: Picture, color: palette.Color, tolerance: int = 40) -> NDArray[np.bool_]:
    gap: NDArray[np.bool_] = np.abs(image.astype(int) - np.array(color)).max(axis=-1) < tolerance
    return gap


def coloured(image: Picture) -> int:
    """Number of things in an image that are not grey: parts a few pixels from each other are one."""
    thick = ndimage.binary_dilation(np.ptp(image.astype(int), axis=-1) > 15, np.ones((9, 9)))
    labels = np.zeros(thick.shape, dtype=np.int64)
    ndimage.label(thick, output=labels)
    return int(labels.max())


def main_panel(image: Picture) -> Picture:
    """The large picture of a report, without the sentence above it: that ends where the frame of the panel begins."""
    edge = np.flatnonzero((image[:200, 5] == np.array([200, 200, 200])).all(axis=-1))[0]
    return image[edge + 1 : SIZE[1] - ROW, : SIZE[0] - COLUMN - 1]


def assert_ringed_in_the_middle(panel: Picture) -> None:
    """The yellow ring is one, and its centre is in the middle third each way."""
    y, x = np.nonzero(near(panel, palette.EVENT))
    assert len(y) > 60
    high, wide = panel.shape[:2]
    middle = (x.min() + x.max()) / 2 / wide, (y.min() + y.max()) / 2 / high
    assert all(1 / 3 < share < 2 / 3 for share in middle), middle
    assert np.ptp(x) == pytest.approx(np.ptp(y), abs=6), "a circle, not several"


def focus_of(run: Replay, kind: str = "ids") -> Focus:
    """The costliest event of a kind, as `mtp-bench events --sort cost --kind` lists it first."""
    events = [each for each in run.incidents if each.kind == kind]
    rows = in_order([Listed.of(run, each, "run", None) for each in events], "cost")
    return Focus(run, rows[0].incident)


# ---- small scenes
def test_the_event_is_bright_and_the_crowd_is_not() -> None:
    run = crowd(ahead=12.0)
    focus = focus_of(run)
    image = np.asarray(report(focus))
    assert image.shape == (SIZE[1], SIZE[0], 3)
    panel = main_panel(image)
    assert_ringed_in_the_middle(panel)
    for role in ("truth", "before", "now"):
        assert near(panel, ROLES[role]).sum() > 30, role
    everything = np.asarray(draw_frame(run, EVENT, Window(0.0, 0.0, 70.0, 70.0)))
    assert coloured(everything[:, : -PANEL - 4]) > 40, "the same frame with everything in colour"
    drawn, marks = draw_focus(focus, EVENT, (900, 450), window_of(focus, EVENT))
    assert coloured(np.asarray(drawn)) <= MOST_BRIGHT
    texts = {mark.text for mark in marks}
    assert {"car 5, true box", "the event", "event gate: within 2 m", "track 2, which follows it", "track 1"} <= texts
    assert {"where it really goes", "forecast now", "forecast at 0.3 s", "other true objects"} <= texts


def test_long_names_in_the_key_are_broken_and_all_marks_have_room() -> None:
    marks = [Mark(f"construction vehicle 9c38502{i}, true box", OBJECT) for i in range(12)]
    image = np.asarray(column((COLUMN, 400), [("The error", 14, palette.BLACK)], marks, parts={"predictor": 2.0}))
    dark = np.argwhere(near(image, palette.BLACK))
    assert 380 < dark[:, 0].max() < 400
    assert dark[:, 1].max() < COLUMN - 3


def test_the_sentences_are_grey_in_frames_of_a_video_beside_the_event() -> None:
    focus = focus_of(crowd(ahead=12.0))
    heads = [np.asarray(picture(focus, t, (960, 720)))[29:52, 14:] for t in (EVENT, EVENT + 1)]
    assert [bool(near(head, palette.BLACK).sum()) for head in heads] == [True, False]


def test_the_file_says_what_it_shows(tmp_path: Path) -> None:
    focus = focus_of(crowd())
    save_report(tmp_path / "a.png", focus)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == SIZE
        assert image.text["Description"] == sentence(focus)  # type: ignore[attr-defined]
    assert (tmp_path / "a.png").stat().st_size < 150_000
    save_report(tmp_path / "b.png", focus)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


# ---- the command
def test_a_picture_needs_neither_rerun_nor_a_screen(
    cli: CommandLine, events_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kitti: str
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "mtp_bench.viz.rerun.sdk", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    shutil.copytree(events_run, tmp_path / "copy")
    cli.ok("view", events_run, tmp_path / "copy", "--data", kitti, "--at", "ids-0", "--png", tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:  # two runs stand below each other
        assert image.size == (SIZE[0], 2 * SIZE[1])


# ---- committed pictures
PICTURES = ("focus_ids", "focus_lost", "focus_reacquired")


@pytest.mark.parametrize("name", PICTURES)
def test_a_committed_picture_says_what_would_be_drawn_today(name: str, repository: Path, tmp_path: Path) -> None:
    path = repository / "docs" / "pictures" / f"{name}.png"
    assert path.stat().st_size < 150_000
    script = runpy.run_path(str(repository / "docs" / "make_pictures.py"))
    script["take"](script["SIMULATED"][name], tmp_path / "now.png")
    with Image.open(path) as committed, Image.open(tmp_path / "now.png") as now:
        shown = [{key: image.text[key] for key in ("Title", "Description")} for image in (committed, now)]  # type: ignore[attr-defined]
        assert shown[0] == shown[1], "make it again: python docs/make_pictures.py"
        assert committed.size == now.size
