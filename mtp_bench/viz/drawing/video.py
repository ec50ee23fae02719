"""Videos of bird's-eye pictures: ``.gif`` by Pillow, ``.mp4`` by PyAV."""

from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...core import Drive, MtpBenchError, whole_file
from ...traffic import RATE
from ..causes import sentence
from ..focus import Focus
from ..framing import Window
from ..incident import Incident
from ..palette import BLACK, FALSE
from ..plan import in_state
from ..run_replay import Replay
from .birds_eye import LARGEST_M, SIZE, draw_frame, windows_of
from .canvas import LARGE
from .report import picture

VIDEO_SUFFIXES = (".mp4", ".gif")
GIF_COLORS = 128
CONTACT_M = 24.0  # that are shown around a collision
MIN_DURATION_MS = 20  # of a picture of a gif: viewers slow down shorter ones
Picture = NDArray[Any]  # uint8 [height, width, 3]


def require_encoder(suffix: str) -> None:
    """Raise MtpBenchError unless files with this suffix can be written here."""
    if suffix == ".mp4":
        try:
            import av  # noqa: F401
        except ImportError:
            raise MtpBenchError(
                "mp4 files need PyAV: `pip install av`, or write a .gif"
            ) from None


def pictures(
    replay: Replay, frames: Iterable[int], at: Incident | None = None
) -> Iterator[Picture]:
    """Draw bird's-eye pictures of ``frames``, all of one size.

    Frames of a drive are its states, the last of which goes on. With an incident the
    pictures are close-ups in which all else is dim.
    """
    drive = replay.rollout.drive
    if at is not None:
        focus = Focus(replay, at)
        for t in frames:
            yield np.asarray(picture(focus, t, SIZE), dtype=np.uint8)
    elif drive is None:
        windows = windows_of(replay.scene, replay.card)
        for t in frames:
            yield draw_frame(replay, t, windows[t])
    else:
        for state in frames:
            yield _draw_state(replay, drive, min(state, len(drive.station) - 1))


@lru_cache(maxsize=1)  # the last state is shown for a second
def _draw_state(replay: Replay, drive: Drive, state: int) -> Picture:
    """Draw a state of a drive, with the answers of the latest decision.

    The ego is in the middle. A collision is drawn from near, with its cause.
    """
    t = min(state // round(RATE / replay.card.task.rate), replay.frames - 1)
    shown = in_state(replay, t, drive, state)
    side_m = 2 * LARGEST_M
    causes = []
    for incident in shown.incidents:
        if incident.kind == "collision":
            side_m = CONTACT_M
            # the cause is measured where the objects were at the decision
            causes.append((sentence(Focus(replay, incident)), LARGE, FALSE))
    x, y = shown.scene.ego[t, :2]
    now = (f"now {state / RATE:.1f} s", LARGE, BLACK)
    return draw_frame(shown, t, Window(x, y, side_m, side_m), [now, *causes])


def write_video(
    path: Path,
    frames: Iterable[Picture],
    rate: float,
    on_frame: Callable[[], object] = lambda: None,
) -> None:
    """Write one or more ``frames`` of `SIZE`, ``rate`` of them per second.

    The file is complete or not there at all. ``on_frame`` is called after each frame.
    """

    def reported_frames() -> Iterator[Picture]:
        for frame in frames:
            yield frame
            on_frame()

    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    try:
        with whole_file(path) as part:
            write(part, reported_frames(), rate)
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None


def _write_gif(path: Path, frames: Iterator[Picture], rate: float) -> None:
    images = (
        Image.fromarray(frame).quantize(GIF_COLORS, dither=Image.Dither.NONE)
        for frame in frames
    )
    next(images).save(
        path,
        format="GIF",
        save_all=True,
        append_images=images,
        duration=max(MIN_DURATION_MS, round(1000 / rate)),
        loop=0,
    )


def _write_mp4(path: Path, frames: Iterator[Picture], rate: float) -> None:
    import av

    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream(
            "libx264", rate=Fraction(rate).limit_denominator(1000)
        )
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"  # every player shows it
        for frame in frames:
            image = av.VideoFrame.from_ndarray(frame, format="rgb24")
            container.mux(stream.encode(image))
        container.mux(stream.encode())
