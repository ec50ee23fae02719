"""Compare the nuScenes source with what the official devkit reads; see README.md.

    python -m tests.parity.compare_nuscenes OUT.npz DATA_ROOT [--split SPLIT] [--record FILE]

OUT.npz is written by nuscenes_devkit.py. Prints a table, and ends with status 1 where anything differs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from mtp_bench import __version__
from mtp_bench.cards import Card, load_card, parse_card, with_split
from mtp_bench.errors import DataError
from mtp_bench.scoring.targets import find_targets
from mtp_bench.sources import open_source
from mtp_bench.sources.nuscenes.names import CLASS_OF, NEUTRAL_OF
from mtp_bench.sources.nuscenes.names import official_scenes as shipped_scenes
from mtp_bench.types import Scene
from tests.parity.nuscenes_checks import (
    SPEED_TOLERANCE,
    TOLERANCE,
    Check,
    box_checks,
    detection_checks,
    pose_checks,
    rows_of,
    target_checks,
    truth_checks,
)
from tests.parity.nuscenes_export import Export, official_classes, official_scenes, packages


def challenge_check(export: Export, card: Card, split: str, data: Path) -> Check:
    """Targets of a split of the challenge over all scenes that both sides have; ours has no split without scenes."""
    what, scenes = f"challenge split {split}", export.challenge_scenes(split)
    card = with_split(card, split)
    try:
        source = open_source(card, data)
    except DataError:
        return Check(what, sum(len(export.challenge(split, name).frame) for name in scenes), 0)
    total = Check(what, 0, 0)
    for name in sorted({*scenes, *source.names}):
        official = export.challenge(split, name)
        if name in source.names:
            scene = source.load(name)
            found = find_targets(scene, card)
            ours = rows_of(scene.truth.start, scene.truth.class_id, scene.truth.box, found.row)
            total += box_checks(what, official, ours)[0]
        else:
            total += Check(what, len(official.frame), 0)
    return total


def with_source(card: Card, **changes: str) -> Card:
    """The card with other keys of its source."""
    content = card.model_dump(mode="json", exclude_none=True)
    return parse_card({**content, "source": {**content["source"], **changes}})


def scenes_of(card: Card, data: Path) -> Iterator[Scene]:
    """The scenes of a card, one by one."""
    source = open_source(card, data)
    for name in source.names:
        yield source.load(name)


def fact_checks(out: Path) -> Iterator[Check]:
    """The lists that both sides ship."""
    for split, official in official_scenes(out).items():
        ours = shipped_scenes()[split]
        yield Check(f"scenes of {split}", len(official), len(ours), len({*official} ^ {*ours}), unit=None)
    classes = {category: name for category, name in official_classes(out).items() if name}
    yield Check(
        "categories with a class", len(classes), len(CLASS_OF), len(classes.items() ^ CLASS_OF.items()), unit=None
    )


def mini_checks(out: Path, data: Path) -> Iterator[Check]:
    """Everything of v1.0-mini: all classes with both detectors, targets by the card of the paper's task."""
    card = load_card("MTP-nuScenes-mini-v0")
    export = Export(out, "v1.0-mini", card.task.classes, NEUTRAL_OF)
    yield scene_check("scenes", export.scenes, card, data)
    for scene in scenes_of(card, data):
        yield from pose_checks(export, scene)
        yield from truth_checks(export, scene)
        yield from detection_checks(export, scene, "megvii")
    few = with_source(card, detector="centerpoint", split="val")
    yield scene_check("scenes with CenterPoint", export.detection_scenes("centerpoint"), few, data)
    for scene in scenes_of(few, data):
        yield from detection_checks(export, scene, "centerpoint")
    listed = with_source(load_card("MTP-nuScenes-v0"), version="v1.0-mini", split="all")
    export = Export(out, "v1.0-mini", listed.task.classes, NEUTRAL_OF)
    for scene in scenes_of(listed, data):
        yield from target_checks(export, scene, listed)
    for split in export.challenge_splits():
        yield challenge_check(export, listed, split, data)


def trainval_checks(out: Path, data: Path, split: str) -> Iterator[Check]:
    """Everything of one split of v1.0-trainval; splits without scenes in the tables must have none on both sides."""
    card = with_split(load_card("MTP-nuScenes-v0"), split)
    export = Export(out, "v1.0-trainval", card.task.classes, NEUTRAL_OF)
    listed = official_scenes(out)[split]
    yield scene_check("scenes", [name for name in export.scenes if name in listed], card, data)
    for scene in scenes_of(card, data):
        yield from pose_checks(export, scene)
        yield from truth_checks(export, scene)
        yield from detection_checks(export, scene, "megvii")
        yield from target_checks(export, scene, card)
    for name in export.challenge_splits():
        if name == split or not export.challenge_scenes(name):
            yield challenge_check(export, card, name, data)


def scene_check(what: str, official: list[str], card: Card, data: Path) -> Check:
    """Names of the scenes."""
    ours = open_source(card, data).names
    return Check(what, len(official), len(ours), len({*official} ^ {*ours}), unit=None)


def totals(checks: Iterable[Check]) -> list[Check]:
    """One check per name, over all scenes."""
    total: dict[str, Check] = {}
    for check in checks:
        total[check.what] = total[check.what] + check if check.what in total else check
    return list(total.values())


def table(version: str, checks: list[Check]) -> list[str]:
    """Markdown table of the checks."""
    lines = [f"## {version}", "", "| | devkit | ours | unpaired | largest difference | |", "|---|--:|--:|--:|--:|---|"]
    for check in checks:
        gap = "" if check.unit is None else f"{check.largest:.2g} {check.unit}".strip()
        verdict = "same" if check.same else "DIFFERENT"
        lines.append(f"| {check.what} | {check.official} | {check.ours} | {check.unpaired} | {gap} | {verdict} |")
    return [*lines, ""]


def main() -> int:
    """Compare, print the result and, where wanted, record it."""
    arguments = argparse.ArgumentParser(description="Compare the nuScenes source with the official devkit.")
    arguments.add_argument("out", type=Path, help="the .npz file of nuscenes_devkit.py")
    arguments.add_argument("data_root", type=Path, help="the data root that it was made from")
    arguments.add_argument("--record", type=Path, help="also write the result to this file")
    arguments.add_argument("--split", default="train", help="of v1.0-trainval")
    given = arguments.parse_args()
    result = {
        "lists": totals(fact_checks(given.out)),
        "v1.0-mini": totals(mini_checks(given.out, given.data_root)),
        f"v1.0-trainval, {given.split}": totals(trainval_checks(given.out, given.data_root, given.split)),
    }
    same = all(check.same for checks in result.values() for check in checks)
    lines = [
        "# nuScenes source and official devkit",
        "",
        f"Devkit: {', '.join(packages(given.out))}. Ours: mtp_bench {__version__}, numpy {np.__version__}.",
        f"Largest difference allowed: {TOLERANCE:g}, of speeds {SPEED_TOLERANCE:g} m/s.",
        "",
        f"Result: {'the same' if same else 'DIFFERENT'}.",
        "",
        *(line for version, checks in result.items() for line in table(version, checks)),
    ]
    text = "\n".join(lines)
    print(text)
    if given.record:
        given.record.write_text(text)
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
