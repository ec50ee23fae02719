"""Compare the nuScenes source with what the devkit reads: `-m benchmarks.parity.compare_nuscenes OUT.npz DATA_ROOT`."""

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mtp_bench import __version__
from mtp_bench.cards import Card, load_card, parse_card
from mtp_bench.core import Floats
from mtp_bench.scoring.targets import find_targets
from mtp_bench.sources.nuscenes.layout import CLASS_OF, CLASSES, official_scenes
from mtp_bench.sources.nuscenes.source import NuScenes

TOLERANCE = 1e-6  # m, rad, s: the files have three to six decimals, so only the noise of float64 arithmetic passes
SPEED_TOLERANCE = 1e-5  # m/s: the devkit divides by differences of seconds since 1970, which float64 has to 2e-7 s
YAW = 3  # column of a box; of a sample it is the last

Rows = dict[str, Floats]  # values by key, as in nuscenes_devkit.py


@dataclass(frozen=True)
class Check:
    """One line of the result: rows on both sides, rows without a counterpart, and the largest difference of a pair."""

    what: str
    official: int
    ours: int
    unpaired: int
    largest: float = 0.0
    allowed: float = TOLERANCE

    @property
    def same(self) -> bool:
        """True if every row has its counterpart, up to the tolerance."""
        return self.unpaired == 0 and self.largest <= self.allowed


def check(
    what: str,
    official: Mapping[str, Floats],
    ours: Mapping[str, Floats],
    columns: slice = slice(None),
    yaw: int | None = None,
) -> Check:
    """Check some columns of all rows; column ``yaw`` is an angle."""
    keys = [key for key in official if key in ours]
    one, other = (
        np.array([rows[key][columns] for key in keys]) for rows in (official, ours)
    )
    gap = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other))
    if yaw is not None and keys:
        gap[:, yaw] = np.abs((gap[:, yaw] + np.pi) % (2 * np.pi) - np.pi)
    largest = float(np.nan_to_num(gap, nan=np.inf).max(initial=0.0))
    return Check(
        what, len(official), len(ours), len(official.keys() ^ ours.keys()), largest
    )


class Export:
    """The arrays of nuscenes_devkit.py."""

    def __init__(self, path: Path) -> None:
        with np.load(path) as file:
            self._arrays = {name: file[name] for name in file.files}

    def rows(self, name: str, scenes: Iterable[str] | None = None) -> Rows:
        """The rows of a part; ``scenes``: only those whose key begins with one of these sample tokens."""
        if f"{name}/key" not in self._arrays:
            return {}
        keys, values = (
            self._arrays[f"{name}/key"].tolist(),
            self._arrays[f"{name}/value"],
        )
        tokens = None if scenes is None else set(scenes)
        chosen = (
            range(len(keys))
            if tokens is None
            else [i for i, k in enumerate(keys) if k.split()[0] in tokens]
        )
        return {keys[i]: np.atleast_1d(values[i]) for i in chosen}


def card_of(env_id: str, **source: str) -> Card:
    """A card of all classes with other keys of its source."""
    content = load_card(env_id).model_dump(mode="json", exclude_none=True)
    card = parse_card({**content, "source": {**content["source"], **source}})
    return card.model_copy(
        update={"task": card.task.model_copy(update={"classes": CLASSES})}
    )


def version_checks(
    export: Export, data: Path, version: str, split: str, detectors: dict[str, str]
) -> Iterator[Check]:
    """Samples, boxes, targets and, by detector and split, detections of the scenes of a split of one version."""
    source = NuScenes(
        card_of("MTP-nuScenes-mini-v0", version=version, split=split), data
    )
    samples, boxes, neutral = Rows(), Rows(), Rows()
    for name in source.names:
        scene, arrays = source.load(name), source.tables.cache.read(name)
        tokens = np.array(source.tables.sample_tokens(name))
        samples |= dict(
            zip(tokens, np.column_stack([arrays["time"], scene.ego]), strict=True)
        )
        truth = scene.truth
        columns = (
            tokens[truth.frame_of_rows],
            arrays["instance"][truth.object_id],
            truth.class_id,
        )
        for sample, instance, kind, box, is_neutral in zip(
            *columns, truth.box, truth.neutral, strict=True
        ):
            key = f"{sample} {instance} {CLASSES[kind]}"
            (neutral if is_neutral else boxes)[key] = box
    official = export.rows(f"{version}/samples", samples)
    yield check("samples: time and place", official, samples, slice(0, 4))
    yield check("samples: yaw", official, samples, slice(4, 5), yaw=0)
    every = export.rows(f"{version}/boxes", samples)
    yield check(
        "true boxes",
        {key: box for key, box in every.items() if key not in neutral},
        boxes,
        yaw=YAW,
    )
    listed = NuScenes(card_of("MTP-nuScenes-v0", version=version, split=split), data)
    yield from target_checks(export, version, listed, samples)
    for detector, detector_split in detectors.items():
        card = card_of(
            "MTP-nuScenes-mini-v0",
            version=version,
            split=detector_split,
            detector=detector,
        )
        rows = detection_rows(export, version, NuScenes(card, data))
        yield check(f"detections of {detector}", *rows, yaw=YAW)


def target_checks(
    export: Export, version: str, source: NuScenes, samples: Iterable[str]
) -> Iterator[Check]:
    """Targets with their futures and speeds, and the targets of the challenge's splits."""
    ours = Rows()
    for name in source.names:
        scene, instance = source.load(name), source.tables.cache.read(name)["instance"]
        tokens = np.array(source.tables.sample_tokens(name))
        targets = find_targets(scene, source.card)
        speed = np.linalg.norm(scene.truth.velocity[targets.row], axis=1)
        values = np.column_stack([targets.future.reshape(len(targets), -1), speed])
        keys = zip(
            tokens[targets.frame], instance[targets.object_id], values, strict=True
        )
        ours |= {f"{sample} {token}": value for sample, token, value in keys}
    official = export.rows(f"{version}/targets", samples)
    yield check("targets: futures", official, ours, slice(0, -1))
    speeds = check("targets: speeds", official, ours, slice(-1, None))
    yield Check(**{**vars(speeds), "allowed": SPEED_TOLERANCE})
    in_tables = set(source.tables.scenes)
    for split, scenes in official_scenes().items():
        own = {
            token
            for name in scenes
            if name in in_tables
            for token in source.tables.sample_tokens(name)
        }
        listed = export.rows(f"{version}/targets of {split}")
        if listed:
            mine = {key: value for key, value in ours.items() if key.split()[0] in own}
            yield check(f"targets of {split}", listed, mine, slice(0, 0))


def detection_rows(export: Export, version: str, source: NuScenes) -> tuple[Rows, Rows]:
    """Official detections and ours, of the scenes of a source."""
    ours, tokens = Rows(), list[str]()
    for name in source.names:
        found, sample = source.load(name).detections, source.tables.sample_tokens(name)
        tokens += sample
        for t, token in enumerate(sample):
            rows = found.rows(t)
            boxes = np.column_stack([found.box[rows], found.score[rows]])
            kinds = found.class_id[rows].tolist()
            ours |= {
                f"{token} {CLASSES[kind]} {i:03d}": boxes[i]
                for i, kind in enumerate(kinds)
            }
    official = Rows()
    for store in source.detections:
        official |= export.rows(f"{version}/{store.path.stem}", tokens)
    return official, ours


def list_checks(export: Export) -> Iterator[Check]:
    """The lists that both sides ship."""
    for split, names in official_scenes().items():
        yield check(
            f"scenes of {split}",
            export.rows(f"scenes of {split}"),
            dict.fromkeys(names, np.zeros(1)),
        )
    classes = {f"{category} {name}": np.zeros(1) for category, name in CLASS_OF.items()}
    yield check("categories with a class", export.rows("categories"), classes)


def table(title: str, checks: Iterable[Check]) -> list[str]:
    """Markdown table of the checks."""
    lines = [
        f"## {title}",
        "",
        "| | devkit | ours | unpaired | largest difference | |",
        "|---|--:|--:|--:|--:|---|",
    ]
    for each in checks:
        verdict = "same" if each.same else "DIFFERENT"
        lines.append(
            f"| {each.what} | {each.official} | {each.ours} | {each.unpaired} | {each.largest:.2g} | {verdict} |"
        )
    return [*lines, ""]


def main() -> int:
    """Compare, print the result and write it to the file of ``--record``."""
    arguments = argparse.ArgumentParser(
        description="Compare the nuScenes source with the official devkit."
    )
    arguments.add_argument("out", type=Path, help="the .npz file of nuscenes_devkit.py")
    arguments.add_argument(
        "data_root", type=Path, help="the data root that it was made from"
    )
    arguments.add_argument(
        "--record", type=Path, help="also write the result to this file"
    )
    arguments.add_argument("--split", default="train", help="of v1.0-trainval")
    given = arguments.parse_args()
    export, data = Export(given.out), given.data_root
    result = {
        "lists": [*list_checks(export)],
        "v1.0-mini": [
            *version_checks(
                export,
                data,
                "v1.0-mini",
                "all",
                {"megvii": "all", "centerpoint": "val"},
            )
        ],
        f"v1.0-trainval, {given.split}": [
            *version_checks(
                export, data, "v1.0-trainval", given.split, {"megvii": given.split}
            )
        ],
    }
    same = all(each.same for checks in result.values() for each in checks)
    text = "\n".join(
        [
            "# nuScenes source and official devkit",
            "",
            f"Devkit: {', '.join(export.rows('versions'))}. Ours: mtp_bench {__version__}, numpy {np.__version__}.",
            f"Largest difference allowed: {TOLERANCE:g} m, rad or s, of speeds {SPEED_TOLERANCE:g} m/s.",
            "",
            f"Result: {'the same' if same else 'DIFFERENT'}.",
            "",
            *(
                line
                for title, checks in result.items()
                for line in table(title, checks)
            ),
        ]
    )
    print(text)
    if given.record:
        given.record.write_text(text)
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
