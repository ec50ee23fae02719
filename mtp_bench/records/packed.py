"""The records that ship: a folder in a checkout, one packed file in the wheel, where room is short."""

from __future__ import annotations

from pathlib import Path

from .._bundle import bundled
from ..errors import MtpBenchError
from ..files import describe_write_error, file_digest, whole_folder
from ..sources.cache import cache_root

PACKED = "records.tar.xz"  # made by hatch_build.py


def shipped_records() -> Path:
    """The folder of the records that ship; those of a wheel are unpacked once, into the user's cache.

    Raises MtpBenchError where they cannot be unpacked.
    """
    leaderboard = bundled("leaderboard")
    packed = leaderboard / PACKED
    return unpacked(packed) if packed.is_file() else leaderboard / "records"


def unpacked(packed: Path) -> Path:
    """The folder ``records`` of a packed file, in the cache."""
    import tarfile

    place = cache_root() / f"records-{file_digest(packed)[:16]}"
    try:
        if not place.is_dir():
            with whole_folder(place) as part, tarfile.open(packed) as archive:
                if hasattr(tarfile, "data_filter"):  # since Python 3.11.4; without it a wheel is trusted as it is
                    archive.extraction_filter = tarfile.data_filter
                archive.extractall(part)
    except (OSError, tarfile.TarError, EOFError) as error:
        why = describe_write_error(error, place) if isinstance(error, OSError) else str(error)
        raise MtpBenchError(f"{packed}: its records cannot be unpacked to {place}: {why}") from None
    return place / "records"
