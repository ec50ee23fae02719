"""What of own scenes is there, for ``mtp-bench data``."""

from __future__ import annotations

from pathlib import Path

from ...cards import Card, FilesSource
from ...cards.own import split_folder
from ...errors import DataError
from ..base import section_of
from ..dataset import Dataset, DataStatus
from .source import EXPECTED, scene_paths

DATASET = Dataset(
    name="own scenes",
    folders=(),
    layout="""\
<folder>/
  <scene>.npz                       a whole scene, or
  <scene>/truth.csv                 true boxes (.parquet, too)
  <scene>/detections.csv            detections (not needed with a simulated detector)
  <scene>/ego.csv                   frames and where the sensors were (optional)""",
    licence="your own",
    citation="your own",
    how_to_get="write them with mtp_bench.save_scene, or import them: mtp-bench import --help",
)


def files_status(card: Card, data: object = None) -> DataStatus:
    """The scenes of the card's folder; reading them tells what is wrong with them."""
    section = section_of(card, FilesSource)
    folder = split_folder(Path(section.folder or ""), section.split)
    if section.scenes is None and (section.folder is None or not folder.is_dir()):
        return DataStatus(DATASET, None, (folder,))
    found = DataStatus(DATASET, folder, (folder,))
    try:
        count = len(scene_paths(folder) if section.scenes is None else section.scenes)
    except DataError as error:
        found.add_problem(error)
        return found
    if not count:
        found.missing.append(EXPECTED)
    found.notes.append(f"scenes: {count}")
    return found
