"""The doctor on healthy recordings and on planted faults.

    python benchmarks/doctor.py limits [--scenes 12] [--json FILE]
    python benchmarks/doctor.py planted [--scenes 3] [--faults late,offset] [--json FILE]

`limits`: the largest value of each kind on healthy scenes of all sources, beside its limit in
`mtp_bench/doctor/kinds.toml`; scenes with an even number are those that limits are set by, the others test them: each
line there is a false one, unless it names a fault that the recording has (`KNOWN`). `planted`: faults of
`doctor_faults.py` in scenes with an odd number, at three strengths: how often a line names them, and how often the
first. "two at once": two faults of different parts, both of which must be named.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.doctor_faults import ALONE, FITTED, Fault
from mtp_bench import load_card, load_scenes
from mtp_bench.cards import Card
from mtp_bench.core import MtpBenchError, Scene
from mtp_bench.doubts import examine, kinds, limit_of
from mtp_bench.sources import in_world, open_source, with_map

PAGE = Path("docs/data/doctor.md")
HEALTHY = Path("mtp_bench/doubts/healthy.toml")
ENVS = (
    "MTP-nuScenes-mini-v0",
    "MTP-KITTI-v0",
    "MTP-AV2-v0",
    "MTP-AV2-10Hz-v0",
    "MTP-ETH-UCY-v0",
    "MTP-WILDTRACK-v0",
    "MTP-PETS-v0",
    "MTP-Intersection-v0",
    "MTP-Roundabout-v0",
    "MTP-Merge-v0",
    "MTP-Highway-v0",
)
# faults that recordings have: (part of the name of the scene, kind)
# and are left out of `planted`
KNOWN = (
    ("biwi_eth", "walking_fast"),
    ("scene-0655", "ego_jump"),
    ("scene-1077", "ego_jump"),
    ("scene-1077", "truth_jump"),
)
FAULTS = (*FITTED, *ALONE)
PAIRS = (
    ("late", "offset"),
    ("turn", "detections doubled"),
    ("offset", "truth jumps"),
    ("scale", "ids exchanged"),
    ("late", "padded with zeros"),
    ("mirrored", "detector hangs"),
    ("box corner", "true l and w exchanged"),
    ("pose late", "classes exchanged"),
)


@dataclass
class Tally:
    """Counts of one fault at one strength."""

    scenes: int = 0
    named: int = 0
    first: int = 0
    others: Counter[str] = field(default_factory=Counter)  # first kinds of the misses


def corpus(scenes: int) -> Iterator[tuple[str, Card, Scene, bool]]:
    """Healthy scenes of all sources at hand, in the world, and whether their number in the env is odd."""
    for env_id in ENVS:
        try:
            card = load_card(env_id)
            names = open_source(card).names[:scenes]
        except MtpBenchError as error:
            print(f"{env_id} is left out: {error}")
            continue
        for number, scene in enumerate(load_scenes(card, names=names)):
            yield env_id, card, with_map(in_world(scene), card), number % 2 == 1


def is_known(scene: str, kind: str) -> bool:
    return any(part in scene and kind == known for part, known in KNOWN)


def limits(scenes: int) -> dict[str, Any]:
    """Largest value of each kind on even scenes, its limit, and false lines on odd ones."""
    largest: dict[str, tuple[float, str]] = {}
    lines, seconds, count = [], [], 0
    for env_id, card, scene, is_odd in corpus(scenes):
        start = time.perf_counter()
        found = examine(scene, card)
        seconds.append(time.perf_counter() - start)
        if not is_odd:
            for sign in found.signs:
                if not is_known(scene.name, sign.kind):
                    largest[sign.kind] = max(
                        largest.get(sign.kind, (0.0, "")),
                        (float(sign.value), env_id),
                    )
        else:
            count += 1
            lines += [
                f"{env_id} {doubt.scene}: {doubt.line}"
                for doubt in found.doubts
                if not is_known(doubt.scene, doubt.kind)
            ]
    table = {kind: (*largest.get(kind, (0.0, "")), limit_of(kind)) for kind in kinds()}
    return {
        "kinds": table,
        "scenes": count,
        "lines": lines,
        "seconds": [float(np.mean(seconds)), max(seconds)],
    }


def write_healthy(table: dict[str, tuple[float, str, float]]) -> None:
    """Write the largest healthy values, from which the limits follow."""
    lines = [
        "# largest values of signs in healthy recordings; written by `benchmarks/doctor.py limits --write`"
    ]
    lines += [
        f"{kind} = {value:.4g}  # {env_id}"
        for kind, (value, env_id, _) in table.items()
        if value > 0
    ]
    HEALTHY.write_text("\n".join(lines) + "\n", encoding="utf-8")


def fits(fault: Fault, scene: Scene, card: Card) -> bool:
    """True if a scene can have the fault."""
    names = np.array(card.task.classes)[scene.truth.class_id]
    counts = np.sort(np.bincount(scene.truth.class_id, minlength=2))
    able = {
        "": True,
        "ego": card.has_ego and float(np.ptp(scene.ego[:, :2], axis=0).max()) > 10.0,
        "cars": int(np.isin(names, ("car", "regular_vehicle")).sum()) > 50,
        "headings": len(names) > 50
        and float(np.ptp(np.quantile(np.sin(scene.truth.box[:, 3]), [0.1, 0.9]))) > 0.5,
        "classes": int(counts[-2]) > 30,
        "scores": bool(np.ptp(scene.detections.score) > 0),
    }
    return able[fault.needs] and len(scene.detections.box) > 50


def planted(scenes: int, names: Sequence[str]) -> dict[str, Any]:
    """Tallies by fault and strength, and of two faults at once."""
    tallies: dict[str, list[Tally]] = defaultdict(lambda: [Tally(), Tally(), Tally()])
    pairs: dict[str, Tally] = defaultdict(Tally)
    by_name = {fault.name: fault for fault in FAULTS}
    for number, (_, card, scene, is_odd) in enumerate(corpus(scenes)):
        if not is_odd or any(part in scene.name for part, _ in KNOWN):
            continue
        for fault in FAULTS:
            if (names and fault.name not in names) or not fits(fault, scene, card):
                continue
            for place, strength in enumerate(fault.strengths):
                if strength in fault.strengths[:place]:
                    continue
                draw = np.random.default_rng([number, place, len(fault.name)])
                _tally(
                    tallies[fault.name][place],
                    [fault],
                    fault.plant(scene, strength, draw),
                    card,
                )
        for pair in combinations_of(names):
            chosen = [by_name[name] for name in pair]
            if all(fits(fault, scene, card) for fault in chosen):
                draw = np.random.default_rng([number, len(pair[0])])
                changed = scene
                for fault in chosen:
                    changed = fault.plant(changed, fault.strengths[1], draw)
                _tally(pairs[" + ".join(pair)], chosen, changed, card)
    return {"faults": dict(tallies), "pairs": dict(pairs)}


def combinations_of(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Pairs that are planted; of chosen faults all pairs."""
    return list(combinations(names, 2)) if names else list(PAIRS)


def _tally(tally: Tally, faults: Sequence[Fault], scene: Scene, card: Card) -> None:
    found = [doubt.kind for doubt in examine(scene, card).doubts]
    tally.scenes += 1
    tally.named += all(
        any(kind in fault.expected for kind in found) for fault in faults
    )
    is_first = bool(found) and any(found[0] in fault.expected for fault in faults)
    tally.first += is_first
    if not is_first:
        tally.others[found[0] if found else "nothing"] += 1


def share(tally: Tally, count: int) -> str:
    return f"{count / tally.scenes:.0%}" if tally.scenes else ""


def planted_lines(found: dict[str, Any]) -> list[str]:
    """Table of the planted faults, and the figures over all of them, in Markdown."""
    lines = [
        "| fault | strengths | scenes | named | first line | else first |",
        "|---|---|--:|---|---|---|",
    ]
    middle, full = [], []
    for fault in FAULTS:
        row = found["faults"].get(fault.name)
        if row is None:
            continue
        strengths = " / ".join(f"{value:g}" for value in dict.fromkeys(fault.strengths))
        used = [tally for tally in row if tally.scenes]
        named = " / ".join(share(tally, tally.named) for tally in used)
        first = " / ".join(share(tally, tally.first) for tally in used)
        center = row[1] if row[1].scenes else row[0]
        middle.append((center.named / center.scenes, center.first / center.scenes))
        if fault.is_whole:
            full.append(used[-1].named / used[-1].scenes)
        others = ", ".join(
            f"{kind.replace('_', ' ')} {count}"
            for kind, count in center.others.most_common(2)
        )
        lines.append(
            f"| {fault.name} | {strengths} | {used[0].scenes} | {named} | {first} | {others} |"
        )
    pairs = found["pairs"]
    for name, tally in pairs.items():
        lines.append(
            f"| {name} | | {tally.scenes} | {share(tally, tally.named)} | {share(tally, tally.first)} | |"
        )
    named_share, first_share = np.mean(middle, axis=0)
    both = np.mean([tally.named / tally.scenes for tally in pairs.values()])
    summary = (
        f"Mean over kinds at the middle strength: named {named_share:.0%}, in the first line {first_share:.0%}. "
        f"Faults of the whole log at full strength: named {np.mean(full):.0%}. Both of two faults: {both:.0%}."
    )
    lines += ["", summary]
    return lines


def write_page(lines: Sequence[str]) -> None:
    """Replace the table on the page of the doctor."""
    before, mark, rest = PAGE.read_text(encoding="utf-8").partition(
        "<!-- planted -->\n"
    )
    _, end, after = rest.partition("<!-- /planted -->")
    if not mark or not end:
        raise SystemExit(f"{PAGE} has no marks for the table of planted faults")
    text = "\n".join(lines)
    PAGE.write_text(f"{before}{mark}\n{text}\n\n{end}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True, dest="command")
    one, two = commands.add_parser("limits"), commands.add_parser("planted")
    one.add_argument("--scenes", type=int, default=12, help="of each environment")
    one.add_argument("--write", action="store_true", help=f"write {HEALTHY.name}")
    two.add_argument(
        "--write", action="store_true", help=f"write the table of {PAGE.name}"
    )
    two.add_argument(
        "--scenes",
        type=int,
        default=4,
        help="of each environment; the odd ones are used",
    )
    two.add_argument("--faults", default="", help="separated by commas; else all")
    for each in (one, two):
        each.add_argument("--json", type=Path)
    given = parser.parse_args()
    if given.command == "limits":
        found = limits(given.scenes)
        for kind, (value, name, limit) in found["kinds"].items():
            print(f"{kind:22s} {value:8.3f} {limit:8.3f}  {name}")
        print(*found["lines"], sep="\n")
        if given.write:
            write_healthy(found["kinds"])
        mean, most = found["seconds"]
        print(
            f"{len(found['lines'])} false lines in {found['scenes']} scenes; {mean:.2f} s a scene, at most {most:.2f}"
        )
    else:
        found = planted(given.scenes, given.faults.split(",") if given.faults else ())
        lines = planted_lines(found)
        print(*lines, sep="\n")
        if given.write:
            write_page(lines)
    if given.json:
        given.json.write_text(
            json.dumps(found, indent=1, default=vars) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
