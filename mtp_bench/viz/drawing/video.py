"""Videos of bird's-eye pictures: ``.gif`` by Pillow, ``.mp4`` by PyAV."""

from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...core import MtpBenchError, whole_file
from ..focus import Focus
from ..incident import Incident
from ..run_replay import Replay
from .birds_eye import SIZE, draw_frame, windows_of
from .report import picture

VIDEO_SUFFIXES = (".mp4", ".gif")
GIF_COLORS = 128
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

    With an incident they are close-ups in which all else is dim.
    """
    if at is None:
        windows = windows_of(replay.scene, replay.card)
        for t in frames:
            yield draw_frame(replay, t, windows[t])
    else:
        focus = Focus(replay, at)
        for t in frames:
            yield np.asarray(picture(focus, t, SIZE), dtype=np.uint8)


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

    codec: Literal["libx264", "mpeg4"] = "mpeg4"
    if "libx264" in av.codecs_available:
        codec = "libx264"
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream(
            codec, rate=Fraction(rate).limit_denominator(1000)
        )
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"  # every player shows it
        for frame in frames:
            image = av.VideoFrame.from_ndarray(frame, format="rgb24")
            container.mux(stream.encode(image))
        container.mux(stream.encode())
