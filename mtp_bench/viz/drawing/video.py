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
COLORS = 128  # of a gif
Picture = NDArray[Any]  # uint8 [height, width, 3]


def require_encoder(kind: str) -> None:
    """Raise MtpBenchError unless files with the suffix ``kind`` of VIDEO_SUFFIXES can be written here."""
    if kind == ".mp4":
        try:
            import av  # noqa: F401
        except ImportError:
            raise MtpBenchError(
                "mp4 files need PyAV: `pip install av`, or write a .gif"
            ) from None


def pictures(
    run: Replay, frames: Iterable[int], at: Incident | None = None
) -> Iterator[Picture]:
    """Bird's-eye pictures of these frames, all of one size; with an incident, close-ups in which all else is dim."""
    if at is None:
        windows = windows_of(run.scene, run.card)
        yield from (draw_frame(run, t, windows[t]) for t in frames)
    else:
        focus = Focus(run, at)
        yield from (np.asarray(picture(focus, t, SIZE), dtype=np.uint8) for t in frames)


def write_video(
    path: Path,
    frames: Iterable[Picture],
    rate: float,
    done: Callable[[], object] = lambda: None,
) -> None:
    """Write one or more ``frames`` of SIZE at ``rate`` per second, complete or not at all; call ``done`` after each."""

    def counted() -> Iterator[Picture]:
        for frame in frames:
            yield frame
            done()

    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    try:
        with whole_file(path) as part:
            write(part, counted(), rate)
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None


def _write_gif(path: Path, frames: Iterator[Picture], rate: float) -> None:
    images = (
        Image.fromarray(frame).quantize(COLORS, dither=Image.Dither.NONE)
        for frame in frames
    )
    duration = max(20, round(1000 / rate))  # ms; viewers slow down shorter ones
    next(images).save(
        path,
        format="GIF",
        save_all=True,
        append_images=images,
        duration=duration,
        loop=0,
    )


def _write_mp4(path: Path, frames: Iterator[Picture], rate: float) -> None:
    import av

    name: Literal["libx264", "mpeg4"] = (
        "libx264" if "libx264" in av.codecs_available else "mpeg4"
    )
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream(name, rate=Fraction(rate).limit_denominator(1000))
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"  # every player shows it
        for frame in frames:
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24"))
            )
        container.mux(stream.encode())
