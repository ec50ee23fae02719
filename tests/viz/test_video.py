"""``mtp-bench video``: files that hold every frame, cut around an event, complete or not there at all."""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mtp_bench.running.stored import open_run
from mtp_bench.viz.drawing.birds_eye import SIZE
from mtp_bench.viz.drawing.video import pictures, write_video
from mtp_bench.viz.framing import AROUND_SECONDS, frames_around
from mtp_bench.viz.run_replay import Replay, replay
from tests.support.command_line import CommandLine

NO_PYAV = pytest.mark.skipif(find_spec("av") is None, reason="PyAV is not installed: pip install av")
ENCODERS = [".gif", pytest.param(".mp4", marks=NO_PYAV)]


def frames_of(path: Path) -> tuple[list[NDArray[Any]], float]:
    """Pictures [height, width, 3] of a video, and how many there are per second."""
    if path.suffix == ".gif":
        with Image.open(path) as image:
            pictures = []
            for i in range(getattr(image, "n_frames", 1)):
                image.seek(i)
                pictures.append(np.asarray(image.convert("RGB")))
            return pictures, 1000 / image.info["duration"]
    import av

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate is not None
        return pictures, float(stream.average_rate)


@pytest.fixture(scope="module")
def drawn(card: str, kitti: str, events_run: Path) -> Callable[[str], Replay]:
    opened = open_run(events_run, kitti, card)
    return lambda scene: replay(opened.scene(scene), opened.first(scene), opened.card, "drawn")


@pytest.mark.parametrize("suffix", ENCODERS)
def test_a_video_holds_every_frame_of_the_first_scene(
    suffix: str, cli: CommandLine, events_run: Path, known: list[str], tmp_path: Path, drawn: Callable[[str], Replay]
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text("earlier")
    printed = cli.ok("video", events_run, "-o", path, *known)
    assert printed == f"{path}: scene 0001, frames 0 to 8, 10 per second\n"
    shown, rate = frames_of(path)
    assert (len(shown), rate) == (9, 10.0)
    expected = next(pictures(drawn("0001"), [4]))
    assert shown[4].shape == (SIZE[1], SIZE[0], 3) == expected.shape
    assert np.abs(shown[4].astype(int) - expected).mean() < 4
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]


def test_an_event_is_shown_with_what_is_around_it(drawn: Callable[[str], Replay]) -> None:
    played = drawn("0001")
    t = played.incident("ids-0").frame
    assert frames_around(played.scene, t) == range(9), "the scene is shorter than what would be shown"
    time = 10 * played.scene.time
    assert frames_around(replace(played.scene, time=time), t) == range(2, 7)
    assert (time[6] - time[4]) < AROUND_SECONDS < (time[7] - time[4])


def test_what_broke_leaves_no_file(tmp_path: Path) -> None:
    def broken() -> Any:
        yield np.zeros((4, 4, 3), dtype=np.uint8)
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_video(tmp_path / "a.gif", broken(), 10.0)
    assert list(tmp_path.iterdir()) == []
