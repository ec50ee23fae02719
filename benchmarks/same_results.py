"""Compare two versions of the library: rollouts, every number of `compare`, and scores of stored runs.

    python benchmarks/same_results.py -o before.json --runs FOLDER --checkout ../old   # a checkout of the older commit
    python benchmarks/same_results.py -o after.json --runs FOLDER --against before.json

Baselines play a few scenes of each environment, eight or more of them on four environments, with learned ones where
weights ship. A lanes id, a closed loop, an environment of highway-env and a log of one's own are among them. Rollouts
are compared array by array, not by the digest of the files, which a change of their form may change.

--runs: the first version stores a run of the whole split of six cards there, and both versions score these runs.

A change of the definitions moves some numbers by design: those that depend on the budgets, where the scenes are not
the whole split of a card. They are listed apart, as are new columns and arrays, and other controls. Exit status 1:
something else differs. Needs MTP_BENCH_DATA or --data. --quick: few agents on few environments, in two minutes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
FEW = ("gt_tracks", "stp", "mtp", "mtp_min_score")
MANY = (
    "gt_tracks",
    "stp",
    "stp_same_samples",
    "stp_hedged",
    "mtp",
    "ab3dmot",
    "stp_min_score",
    "mtp_min_score",
)
LEARNED = (
    "mtp_modes",
    "stp_modes_tracklets",
    "gt_tracks_modes",
    "mtp_ptp",
    "affinity",
    "tracking_free",
)
FULL_RUNS = (
    "MTP-PETS-v0",
    "MTP-WILDTRACK-v0",
    "MTP-nuScenes-mini-v0",
    "MTP-KITTI-v0",
    "MTP-ETH-UCY-v0",
    "MTP-Highway-v0",
)
FULL_RUN_AGENT = "mtp"
NOT_RESULTS = ("seconds", "scene")  # arrays of a stored rollout
TIMES = ("ms_per_frame",)  # fields of a row
ROW_KEYS = ("agent", "hypotheses", "samples", "budget", "subset")
ON_BUDGET = (
    "error",
    "interval",
    "localisation",
    "missed",
    "error_by_score",
    "p",
    "place",
    "rank_range",
    "unranked_because",
    "bins",
    "own",
)
ON_BUDGET_PREFIXES = ("cost_", "difference_", "gap_", "association_gap_")
ON_OTHER_AGENTS = ("place", "rank_range")
MISSING = "missing"

GYM_SOURCE = """[source]
name = "gym"
id = "intersection-v1"
config = { simulation_frequency = 10, spawn_probability = 0.3 }
policy = "idm"
seconds = 13.0
seeds = { train = [0, 2], val = [100, 103], test = [200, 202] }

"""


class Case(NamedTuple):
    """Agents on some scenes of an environment."""

    env: str
    scenes: int | None = None  # the first of the split, None: all
    agents: tuple[str, ...] = FEW
    options: tuple[str, ...] = ()  # further ones of `run` and `compare`

    @property
    def whole_split(self) -> bool:
        """True if definitions 3.1 give these scenes the same budgets as 3.0."""
        return self.scenes is None and not self.options and self.env.startswith("MTP-")


Part = dict[
    str, dict[str, dict[str, Any]]
]  # of a case: values by section, name and field


class Difference(NamedTuple):
    """A value that two versions do not share."""

    section: str
    name: str
    field: str
    before: Any
    after: Any

    def __str__(self) -> str:
        return f"{self.section}/{self.name}/{self.field}: {self.before!r} -> {self.after!r}"


def cases(folder: Path) -> dict[str, Case]:
    """Return all cases by name. The card and the log that do not ship are written to ``folder``."""
    shipped = [
        Case("MTP-Intersection-v0", 3, MANY + LEARNED),
        Case("MTP-KITTI-v0", 2, MANY),
        Case("MTP-nuScenes-mini-v0", 2, MANY),
        Case("MTP-WILDTRACK-v0", None, MANY),
        Case("MTP-PETS-v0"),
        Case("MTP-ETH-UCY-v0", 2),
        Case(
            "MTP-Intersection-Lanes-v0",
            2,
            ("gt_tracks", "stp_lanes", "mtp_lanes", "mtp_modes_lanes"),
        ),
        Case("MTP-Drive-Intersection-v0", 2, ("gt_tracks", "stp", "mtp", "blind")),
        Case("MTP-AV2-v0"),
        Case("MTP-nuScenes-v0", 2, FEW, ("--split", "train")),
        Case("MTP-Highway-v0", 2, FEW + LEARNED[:2]),
        Case("MTP-Roundabout-v0", 2),
        Case("MTP-Merge-v0", 2),
        Case("MTP-IntersectionRaw-v0", 2),
        Case("MTP-KITTI-noego-v0", 2),
        Case("MTP-KITTI-5Hz-v0", 2),
        Case("MTP-WILDTRACK-k10-v0"),
        Case("MTP-AV2-10Hz-v0", 2),
        Case("MTP-nuScenes-CenterPoint-v0", 2),
    ]
    own = {
        "highway-env": Case(str(write_gym_card(folder))),
        "own log": Case(
            "MTP-nuScenes-mini-v0", None, FEW, ("--files", str(write_own_log(folder)))
        ),
    }
    return {case.env: case for case in shipped} | own


QUICK = (
    "MTP-Intersection-v0",
    "MTP-KITTI-v0",
    "MTP-nuScenes-mini-v0",
    "MTP-WILDTRACK-v0",
)
ONLY_WHERE_ASKED = (
    "MTP-nuScenes-CenterPoint-v0",
)  # it needs the validation scenes of nuScenes


def write_gym_card(folder: Path) -> Path:
    """Write the card of MTP-Roundabout-v0 with a stock environment of highway-env as its source."""
    shipped = (ROOT / "envs" / "MTP-Roundabout-v0.toml").read_text(encoding="utf-8")
    head, _, rest = shipped.partition("[source]")
    detector = rest[rest.index("[detector]") :]
    card = folder / "MTP-Stock-v0.toml"
    card.write_text(
        head.replace("MTP-Roundabout-v0", "MTP-Stock-v0") + GYM_SOURCE + detector,
        encoding="utf-8",
    )
    return card


def write_own_log(folder: Path) -> Path:
    """Write a folder of one scene: two cars, of which one is hidden for 2 s, and a false one of a low score."""
    scene = folder / "log" / "two_cars"
    scene.mkdir(parents=True, exist_ok=True)
    truth = ["frame,id,class,x,y,yaw,l,w,h"]
    detections = ["frame,class,x,y,yaw,l,w,h,score"]
    for frame in range(40):
        for car in (0, 1):
            box = f"car,{2 * frame + 9 * car},{4 * car},0,4.5,1.8,1.6"
            truth.append(f"{frame},{car},{box}")
            if car == 1 or not 12 <= frame < 16:
                detections.append(f"{frame},{box},0.9")
        detections.append(f"{frame},car,30,-20,0,4.5,1.8,1.6,0.1")
    (scene / "truth.csv").write_text("\n".join(truth) + "\n", encoding="utf-8")
    (scene / "detections.csv").write_text(
        "\n".join(detections) + "\n", encoding="utf-8"
    )
    return scene.parent


def command(checkout: Path, *arguments: str) -> None:
    """Run `mtp-bench` of a checkout, whichever version is installed."""
    # -m puts the working folder before everything else: it must be the checkout too
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    program = [sys.executable, "-m", "mtp_bench", *arguments]
    subprocess.run(
        program, cwd=checkout, env=environment, check=True, stdout=subprocess.DEVNULL
    )


def rollouts(folder: Path) -> dict[str, str]:
    """Return a hash of each array of each stored scene by `scene/array`, times left out."""
    hashes = {}
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as arrays:
            for name in sorted(arrays.files):
                if name not in NOT_RESULTS:
                    array = np.ascontiguousarray(arrays[name])
                    content = (
                        f"{array.dtype.str}{array.shape}".encode() + array.tobytes()
                    )
                    hashes[f"{path.stem}/{name}"] = hashlib.sha256(content).hexdigest()[
                        :16
                    ]
    return hashes


def table(path: Path) -> Part:
    """Return rows, details and definitions of a table that `compare` or `score` wrote, without times."""
    content = json.loads(path.read_text(encoding="utf-8"))
    part: Part = {"table": {"all": {"definitions": content.get("definitions")}}}
    for section in ("rows", "details"):
        part[section] = {}
        for row in content.get(section, []):
            name = " ".join(str(row[key]) for key in ROW_KEYS if key in row)
            part[section][name] = {
                key: value for key, value in row.items() if key not in TIMES
            }
    return part


def played(checkout: Path, further: list[str], case: Case) -> Part:
    """Return rollouts and rows of the agents of a case, from `run` and `compare` of a checkout."""
    some = [] if case.scenes is None else ["--scenes", str(case.scenes)]
    common = ["--env", case.env, *further, *some, *case.options]
    seeds = "2" if case.whole_split else "1"
    with tempfile.TemporaryDirectory() as folder:
        arrays = {}
        for agent in case.agents:
            print(f"{case.env}: {agent}", file=sys.stderr, flush=True)
            output = Path(folder, agent)
            command(checkout, "run", agent, "-o", str(output), *common)
            arrays[agent] = rollouts(output)
        print(f"{case.env}: compare", file=sys.stderr, flush=True)
        file = Path(folder, "compare.json")
        command(
            checkout,
            "compare",
            *case.agents,
            "--seeds",
            seeds,
            "--json",
            str(file),
            *common,
        )
        return {"rollouts": arrays, **table(file)}


def scored(checkout: Path, data: str, env: str, runs: Path) -> Part:
    """Return the scores of the stored run of a whole split; the run is made first if ``runs`` lacks it."""
    run = runs / env
    if not run.exists():
        print(f"{env}: run of the whole split", file=sys.stderr, flush=True)
        command(
            checkout,
            "run",
            FULL_RUN_AGENT,
            "--env",
            env,
            "--data",
            data,
            "-o",
            str(run),
        )
    print(f"{env}: score of the whole split", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "score.json")
        command(checkout, "score", str(run), "--data", data, "--json", str(file))
        return table(file)


def differences(before: Part, after: Part) -> Iterator[Difference]:
    """Yield the values of a case that differ, those that only one version has included."""
    for section in sorted({*before, *after}):
        old_section = before.get(section, {})
        new_section = after.get(section, {})
        for name in sorted({*old_section, *new_section}):
            old = old_section.get(name, {})
            new = new_section.get(name, {})
            for field in sorted({*old, *new}):
                values = old.get(field, MISSING), new.get(field, MISSING)
                if values[0] != values[1]:
                    yield Difference(section, name, field, *values)


def by_design(
    difference: Difference, case: Case | None, before: Part, after: Part
) -> bool:
    """Return True if a difference is what new definitions, columns or controls bring; no case: a stored run."""
    section, name, field = difference[:3]
    if section == "table" or difference.before == MISSING:
        return True
    if section == "rollouts" or case is None:
        return False
    if difference.after == MISSING:
        return name not in after[section] and name.split(" ")[0] not in case.agents
    if field in ON_OTHER_AGENTS and before["rows"].keys() != after["rows"].keys():
        return True
    depends = field in ON_BUDGET or field.startswith(ON_BUDGET_PREFIXES)
    return depends and not case.whole_split and before["table"] != after["table"]


def summary(found: list[Difference]) -> str:
    """Return one line on differences by design: of bADE with its range in metres, of others the fields."""
    values: dict[str, list[Difference]] = defaultdict(list)
    for each in found:
        kind = "only in one version, " if MISSING in (each.before, each.after) else ""
        values[f"{kind}{each.section}/{each.field}"].append(each)
    texts = []
    for field, these in values.items():
        steps = [
            each.after - each.before
            for each in these
            if field == "rows/error" and None not in each[3:]
        ]
        span = f", {min(steps):+.4f} to {max(steps):+.4f} m" if steps else ""
        texts.append(f"{field} ({len(these)}{span})")
    return "; ".join(texts)


def report(
    before: dict[str, Part], after: dict[str, Part], known: dict[str, Case]
) -> bool:
    """Print what differs by design, then what else differs; return True if anything else does."""
    faults = []
    for name, part in after.items():
        old = before.get(name, {})
        found = list(differences(old, part))
        expected = [
            each
            for each in found
            if old and by_design(each, known.get(name), old, part)
        ]
        faults += [f"{name}: {each}" for each in found if each not in expected]
        if expected:
            print(f"by design, {name}: {summary(expected)}")
    sizes = dict.fromkeys(("rollouts", "rows", "details"), 0)
    for part in after.values():
        for section in sizes.keys() & part.keys():
            sizes[section] += sum(len(fields) for fields in part[section].values())
    compared = f"{sizes['rollouts']} arrays of rollouts, {sizes['rows']} entries of rows, {sizes['details']} of details"
    for fault in faults:
        print(fault)
    print(f"differences not by design: {len(faults)}; compared: {compared}")
    return bool(faults)


def main() -> None:
    """Make the results of a checkout and, with --against, list what differs from another's."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="file for the results"
    )
    parser.add_argument(
        "--checkout",
        type=Path,
        default=ROOT,
        help="the version to run; default: this one",
    )
    parser.add_argument(
        "--data",
        default=os.environ.get("MTP_BENCH_DATA"),
        help="data root; else MTP_BENCH_DATA",
    )
    parser.add_argument("--against", type=Path, help="results of another version")
    parser.add_argument(
        "--runs",
        type=Path,
        help="folder of stored runs of whole splits, made if they are missing",
    )
    parser.add_argument(
        "--env",
        action="append",
        help="only this case: an environment, 'highway-env' or 'own log'",
    )
    parser.add_argument("--jobs", default="0", help="processes; 0 takes one per core")
    parser.add_argument(
        "--quick", action="store_true", help="few agents on few environments"
    )
    options = parser.parse_args()
    if options.data is None:
        parser.error("no data root: give --data or set MTP_BENCH_DATA")
    checkout = options.checkout.resolve()
    data = str(Path(options.data).resolve())
    further = ["--data", data, "--jobs", options.jobs]
    before = (
        json.loads(options.against.read_text(encoding="utf-8"))
        if options.against
        else {}
    )
    made: dict[str, Part] = {}

    def keep(name: str, part: Part) -> None:
        """Keep the results of a case, in the file too."""
        made[name] = part
        options.output.write_text(
            json.dumps(made, indent=1, sort_keys=True), encoding="utf-8"
        )

    with tempfile.TemporaryDirectory() as folder:
        known = cases(Path(folder))
        usual = (
            QUICK
            if options.quick
            else [name for name in known if name not in ONLY_WHERE_ASKED]
        )
        if before:
            usual = [name for name in known if name in before]
        if unknown := sorted({*(options.env or [])} - known.keys()):
            parser.error(f"--env {unknown[0]!r}: expected one of {', '.join(known)}")
        for name in options.env or usual:
            if options.quick:
                case = known[name]
                known[name] = case._replace(scenes=1, agents=case.agents[:5])
            keep(name, played(checkout, further, known[name]))
        for env in FULL_RUNS if options.runs else ():
            keep(
                f"stored run, {env}",
                scored(checkout, data, env, options.runs.resolve()),
            )
    if before:
        sys.exit(report(before, json.loads(json.dumps(made)), known))


if __name__ == "__main__":
    main()
