"""Times what a user waits for, cold and warm, and the ratio to another commit.

    python benchmarks/user_day.py [--against COMMIT] [--rows board,step] [--data DIR] [--trainval DIR] [--json FILE]

Every row is a process of its own, with a cache folder of its own that is empty in rows called "cold". A row counts the
CPU seconds, user and system, of the process and of those that it started, its wall time, and the peak resident memory
of the largest of these processes. With ``--against`` the row runs in a copy of that commit, too, one right after the
other, with the same interpreter and the same packages, and those in a folder of ``PYTHONPATH``. A row that fails there,
because that commit lacks what it needs, is blank.

Rows in ms are CPU time, counted inside their process without start and compilation; the others are whole commands.
Steps and resets: means over whole scenes, one that the environment chooses and then the first of the split again and
again, until 200 steps are made. "A frame": mean time of an agent's ``act`` over the first scene of the split, the
least of three plays after one that is not counted.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parents[1]
NOISY = "MTP-Intersection-v0"

# A small process: the peak of a child is at least the memory of the process that starts it.
STARTER = """
import os, resource, sys
code = os.spawnv(os.P_WAIT, sys.argv[2], sys.argv[2:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
with open(sys.argv[1], "w") as usage:
    usage.write(f"{used.ru_utime + used.ru_stime} {used.ru_maxrss / 1024}")
sys.exit(code if code >= 0 else 1)
"""
STEPS = """
import sys, time, numpy as np, gymnasium as gym, mtp_bench
env = gym.make(sys.argv[1], **({"evaluation": True} if sys.argv[2] == "evaluation" else {})).unwrapped
def standing(seen):
    valid = seen["detection_valid"] == 1
    box = seen["detection_box"][valid]
    return mtp_bench.make_action(
        env.task, box, seen["detection_class"][valid], np.zeros((len(box), env.task.future, 2), np.float32)
    )
seen, _ = env.reset(seed=0)
spent = steps = resets = reset_time = 0
while steps < 200:
    start = time.process_time()
    seen, _ = env.reset(options={"scene": env.scene_names[0]} if resets else None)
    reset_time, resets, over = reset_time + time.process_time() - start, resets + 1, False
    while not over:
        answer, start = standing(seen), time.process_time()
        seen, _, over, cut, _ = env.step(answer)
        spent, steps, over = spent + time.process_time() - start, steps + 1, over or cut
print("MS", 1000 * spent / steps, 1000 * reset_time / resets)
"""
OPENED = """
import sys, gymnasium as gym, mtp_bench
gym.make(sys.argv[1]).reset(seed=0)
"""
AGENT = """
import sys, time
from dataclasses import replace
from mtp_bench.env.environment import MTPEnv
from mtp_bench.cards import load_card
from mtp_bench.running.playing import run_scene
from mtp_bench.running.settings import setting_of
from mtp_bench.agent.loader import SubmissionFactory, load_submission
card = load_card(sys.argv[1])
setting = setting_of(load_submission(sys.argv[2]), card)
make = SubmissionFactory(str(setting.submission.path), setting.parameters)
def play():
    env = MTPEnv(card, **setting.env_keywords(card), evaluation=True)
    name = env.scene_names[0]
    agent = make(replace(env.task, seed=0))
    spent, act = [0.0, 0], agent.act
    def timed(observation):
        start = time.process_time()
        answer = act(observation)
        spent[0], spent[1] = spent[0] + time.process_time() - start, spent[1] + 1
        return answer
    agent.act = timed
    run_scene(agent, env, name, 0, sys.argv[2])
    return 1000 * spent[0] / spent[1]
play()
print("MS", min(play() for _ in range(3)))
"""
K_BEST = """
import sys, time, numpy as np, mtp_bench
import mtp_bench.tracking.tracker as tracker_module
from mtp_bench.env.environment import MTPEnv
from mtp_bench.tracking import HypothesisTracker
search, calls = tracker_module.joint_k_best, []
def recorded(*arguments):
    calls.append(tuple(getattr(each, "copy", lambda each=each: each)() for each in arguments))
    return search(*arguments)
tracker_module.joint_k_best = recorded
env = MTPEnv(sys.argv[1])
tracker = HypothesisTracker(20)
tracker.reset(env.task)
observation, _ = env.reset(options={"scene": env.scene_names[0]})
nothing = mtp_bench.make_action(
    env.task, np.zeros((0, 7)), np.zeros(0, int), np.zeros((0, env.task.future, 2))
)
is_over = False
while not is_over:
    tracker.step(observation)
    observation, _, terminated, truncated, _ = env.step(nothing)
    is_over = terminated or truncated
def play():
    start = time.process_time()
    for call in calls:
        search(*call)
    return 1000 * (time.process_time() - start) / len(calls)
print("MS", min(play() for _ in range(20)))
"""
EPOCHS = """
import pathlib, sys, time
from mtp_bench.running import RunOptions
from mtp_bench.training import TrainingPlan, TrainingRequest, train_predictor, training_windows
request = TrainingRequest(sys.argv[2], sys.argv[1], plan=TrainingPlan(6), device="cpu")
windows = training_windows(request, RunOptions(split="train"))
marks = []
train_predictor(windows, request, pathlib.Path(sys.argv[3]), lambda *_: marks.append(time.process_time()))
# of its stages, 60 and 40 % of the epochs, the first is not counted
print("MS", 1000 * (marks[3] - marks[0]) / 3, 1000 * (marks[5] - marks[3]) / 2)
"""
KERNELS = """
try:
    from mtp_bench.running.playing import compile_kernels
    given = 2
except ImportError:  # of a commit in which the gateway had them
    from mtp_bench.judge.gateway.layout import compile_kernels
    given = 0
if given:
    from mtp_bench.core.parallel import Workers
    compile_kernels(Workers(given))
else:
    compile_kernels()
"""
FRESH = """
import sys, time, gymnasium as gym, mtp_bench
env = gym.make(sys.argv[1])
names = env.unwrapped.scene_names
env.reset(seed=0, options={"scene": names[0]})
start = time.process_time()
for name in names[1:5]:
    env.reset(options={"scene": name})
print("MS", 1000 * (time.process_time() - start) / 4)
"""
TRAINING = """
import inspect, sys, time, gymnasium as gym, stable_baselines3 as sb3, torch, mtp_bench
from mtp_bench.wrappers import AssociationOnly
torch.set_num_threads(1)
env = gym.make(sys.argv[1], split="train", scenes=mtp_bench.MTPEnv(sys.argv[1], split="train").scene_names[:4])
sizes = {"n_steps": 256, "batch_size": 256, "policy_kwargs": {"net_arch": [32]}}
same = {"relative": False} if "relative" in inspect.signature(AssociationOnly).parameters else {}  # 4c9bd60a lacks it
env = AssociationOnly(env, detections=16, choices=1, **same)
agent = sb3.PPO("MlpPolicy", env, seed=0, device="cpu", **sizes)
agent.learn(256)
start = time.process_time()
agent.learn(1024)
print("MS", 1000 * (time.process_time() - start) / 1024)
"""

ASSOCIATION = """
import sys, time, gymnasium as gym, mtp_bench
from mtp_bench.wrappers import AssociationOnly
names = mtp_bench.MTPEnv(sys.argv[1]).scene_names[:4]
env = AssociationOnly(gym.make(sys.argv[1], scenes=names))
env.action_space.seed(0)
def play(episodes):
    spent = reset_time = steps = 0
    for episode in range(episodes):
        start = time.process_time()
        env.reset(options={"scene": names[episode % len(names)]})
        reset_time, over = reset_time + time.process_time() - start, False
        while not over:
            action, start = env.action_space.sample(), time.process_time()
            _, _, over, _, _ = env.step(action)
            spent, steps = spent + time.process_time() - start, steps + 1
    return 1000 * spent / steps, 1000 * reset_time / episodes
play(len(names))
print("MS", *play(2 * len(names)))
"""


@dataclass(frozen=True)
class Row:
    """A row: Python code with arguments, or words of the command line."""

    name: str
    aim: str  # in the row's unit
    words: tuple[str, ...]
    code: str = ""
    cold: bool = False  # in an empty cache; else the row ran before, uncounted
    trainval: bool = False  # reads nuScenes trainval
    codes: tuple[int, ...] = (0,)  # exit codes of success
    warmed: str = ""  # the cold row whose cache it goes on with
    before: tuple[
        str, ...
    ] = ()  # words of the command that is run first, uncounted, in place of the row itself
    has_ratio: bool = True  # False: both commits do not do the same


COMPARE = ("compare", "stp", "mtp", "--env", NOISY, "--scenes", "10", "--jobs", "2")
ROWS = {
    "help": Row("mtp-bench --help", "0.5 s", ("--help",)),
    "import": Row("import mtp_bench", "0.5 s", (), "import mtp_bench"),
    "compare-cold": Row("compare, cold", "150 s", COMPARE, cold=True),
    "compare": Row("compare, warm", "60 s", COMPARE, warmed="compare-cold"),
    "board": Row("board", "6 s", ("board",)),
    "board-env": Row("board of an environment", "2 s", ("board", "--env", NOISY)),
    "open-cold": Row(
        "first open, nuScenes trainval",
        "5 s",
        ("MTP-nuScenes-v0",),
        OPENED,
        cold=True,
        trainval=True,
    ),
    "open": Row(
        "open again",
        "0.34 s",
        ("MTP-nuScenes-v0",),
        OPENED,
        trainval=True,
        warmed="open-cold",
    ),
    "step": Row("step and reset, Intersection", "1.0, 10 ms", (NOISY, "play"), STEPS),
    "step-evaluation": Row(
        "step and reset in an evaluation, Intersection",
        "0.4, – ms",
        (NOISY, "evaluation"),
        STEPS,
    ),
    "step-mini": Row(
        "step and reset, nuScenes mini",
        "1.0, 5 ms",
        ("MTP-nuScenes-mini-v0", "play"),
        STEPS,
    ),
    "training": Row(
        "step of PPO (SB3), Roundabout", "–", ("MTP-Roundabout-v0",), TRAINING
    ),
    "association": Row(
        "step and reset of AssociationOnly, Intersection",
        "3, 10 ms",
        (NOISY,),
        ASSOCIATION,
    ),
    "training-start": Row(
        "train modes for an epoch, one scene of nuScenes mini",
        "4 s",
        (
            *("train", "predictor", "modes", "--env", "MTP-nuScenes-mini-v0"),
            *("--on", "truth", "--scenes", "1", "--epochs", "1"),
            *("-o", "{cache}/weights.safetensors"),
        ),
    ),
    "mtp": Row("mtp a frame, Intersection", "1.5 ms", (NOISY, "mtp"), AGENT),
    "mtp-kitti": Row("mtp a frame, KITTI", "1.5 ms", ("MTP-KITTI-v0", "mtp"), AGENT),
    "mtp-mini": Row(
        "mtp a frame, nuScenes mini", "1.5 ms", ("MTP-nuScenes-mini-v0", "mtp"), AGENT
    ),
    "stp-mini": Row(
        "stp a frame, nuScenes mini", "1.5 ms", ("MTP-nuScenes-mini-v0", "stp"), AGENT
    ),
    "k-best": Row(
        "k-best association, H = 20, KITTI", "0.0235 ms", ("MTP-KITTI-v0",), K_BEST
    ),
    "ptp-epoch": Row(
        "epoch of ptp, autoencoder and diverse, nuScenes mini",
        "-",
        ("MTP-nuScenes-mini-v0", "ptp", "{cache}/ptp.safetensors"),
        EPOCHS,
    ),
    # 4c9bd60a compiles 13 of the 15 kernels here, the others when they are first used
    "kernels": Row(
        "kernels, once per installation",
        "30 s",
        (),
        KERNELS,
        cold=True,
        has_ratio=False,
    ),
    "fresh": Row(
        "fresh simulated scene, Intersection", "700 ms", (NOISY,), FRESH, cold=True
    ),
    "score": Row(
        "score mtp on nuScenes val",
        "6 s",
        ("score", "{cache}/run"),
        trainval=True,
        before=("run", "mtp", "--env", "MTP-nuScenes-v0", "--output", "{cache}/run"),
    ),
    "data": Row(
        "mtp-bench data", "1.5 s", ("data",), codes=(0, 1)
    ),  # 1: data is not complete
}


@dataclass(frozen=True)
class Spent:
    """Cost of a row; ``ms``: counted inside, of one step, reset or frame."""

    cpu: float
    wall: float
    peak: float  # MiB of the largest process
    ms: tuple[float, ...] = ()

    @property
    def brief(self) -> str:
        """The time of the processor."""
        return (
            ", ".join(f"{each:.3g}" for each in self.ms) + " ms"
            if self.ms
            else f"{self.cpu:.1f} s"
        )

    @property
    def shown(self) -> str:
        """A cell of the table."""
        return (
            self.brief
            if self.ms
            else f"{self.brief} CPU, {self.wall:.1f} s, {self.peak:.0f} MiB"
        )

    def ratio(self, other: Spent) -> str:
        """Ratio of what ``other`` took to this."""
        if self.ms:
            return ", ".join(
                f"{b / a:.1f}x" for a, b in zip(self.ms, other.ms, strict=False)
            )
        return f"{other.cpu / max(self.cpu, 0.01):.1f}x"


def spent(row: Row, tree: Path, cache: Path, given: argparse.Namespace) -> Spent | None:
    """Run a row in a copy of the project; None if it fails there."""
    path = os.pathsep.join([str(tree), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {
        **os.environ,
        "PYTHONPATH": path,
        "MTP_BENCH_CACHE": str(cache / "cache"),
    }
    environment |= {
        "NUMBA_CACHE_DIR": str(cache / "numba"),
        "XDG_CACHE_HOME": str(cache / "xdg"),
    }
    environment["MTP_BENCH_DATA"] = str(given.trainval if row.trainval else given.data)
    command = [
        sys.executable,
        *(("-c", row.code) if row.code else ("-m", "mtp_bench")),
        *(word.format(cache=cache) for word in row.words),
    ]
    start = time.perf_counter()
    with tempfile.NamedTemporaryFile("r") as usage:
        program = [sys.executable, "-ISc", STARTER, usage.name, *command]
        done = subprocess.run(
            program,
            cwd=tree,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        wall = time.perf_counter() - start
        text, reason, (cpu, peak) = (
            done.stdout,
            done.stderr,
            map(float, usage.read().split()),
        )
    if done.returncode not in row.codes:
        print(
            f"{row.name} in {tree.name}: {reason.strip().splitlines()[-1] if reason.strip() else 'failed'}",
            flush=True,
        )
        return None
    ms = [line.split()[1:] for line in text.splitlines() if line.startswith("MS ")]
    return Spent(cpu, wall, peak, tuple(float(each) for line in ms for each in line))


def ratio_of(row: Row, then: Spent | None, now: Spent | None) -> str:
    """Cell of how many times longer the other commit took; empty where that says nothing."""
    return now.ratio(then) if now and then and row.has_ratio else ""


@dataclass
class Tree:
    """A copy of the project, its caches, and the cold rows that were finished there."""

    path: Path
    caches: Path
    finished: set[str] = field(default_factory=set)

    def measure(self, key: str, given: argparse.Namespace) -> Spent | None:
        """A row; one that is neither cold nor goes on with a finished cold row is run before, uncounted."""
        row = ROWS[key]
        own = self.caches / (key if row.cold else row.warmed or "warm")
        first = replace(row, words=row.before) if row.before else row
        is_ready = row.cold or row.warmed in self.finished
        if not is_ready and spent(first, self.path, own, given) is None:
            return None
        found = spent(row, self.path, own, given)
        self.finished |= {key} if found else set()
        return found


def copy_of(commit: str, folder: Path) -> Path:
    """The files of a commit in a new folder."""
    tree = folder / "against"
    tree.mkdir()
    packed = subprocess.run(
        ["git", "archive", commit], cwd=HERE, check=True, capture_output=True
    ).stdout
    subprocess.run(["tar", "x"], cwd=tree, input=packed, check=True)
    return tree


def heads(against: str) -> tuple[str, ...]:
    """Heads of the columns behind the name of a row; ``against``: of the other commit, empty without one."""
    return ("aim", against, "now", "ratio") if against else ("aim", "now")


def markdown(found: dict[str, tuple[Spent | None, Spent | None]], against: str) -> str:
    """The rows as a table of Markdown, as docs/project/speed.md has it."""
    columns = ["what", *heads(against), "memory now, MiB"]
    lines = [
        "| " + " | ".join(columns) + " |",
        "|---" + "|--:" * (len(columns) - 1) + "|",
    ]
    for key, (then, now) in found.items():
        row, cells = ROWS[key], [each.brief if each else "" for each in (then, now)]
        cells = [*cells, ratio_of(row, then, now)] if against else cells[1:]
        lines.append(
            "| "
            + " | ".join([row.name, row.aim, *cells, f"{now.peak:.0f}" if now else ""])
            + " |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", metavar="COMMIT", default="")
    parser.add_argument(
        "--label", help="head of the column of COMMIT; its name if left out"
    )
    parser.add_argument("--rows", default=",".join(ROWS), help=f"of {', '.join(ROWS)}")
    parser.add_argument(
        "--data",
        type=Path,
        default=os.environ.get("MTP_BENCH_DATA"),
        help="else MTP_BENCH_DATA",
    )
    parser.add_argument(
        "--trainval",
        type=Path,
        help="folder with nuScenes trainval; that of --data if left out",
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument(
        "--markdown", type=Path, help="file for the table of docs/project/speed.md"
    )
    given = parser.parse_args()
    if given.data is None:
        parser.error("name the folder of the recordings: --data DIR, or MTP_BENCH_DATA")
    if unknown := set(given.rows.split(",")) - set(ROWS):
        parser.error(
            f"--rows: got {', '.join(sorted(unknown))}, expected some of {', '.join(ROWS)}"
        )
    given.trainval, label = given.trainval or given.data, given.label or given.against
    table = Table(title=f"What a user waits for, {os.cpu_count()} cores")
    for head in ("", *heads(label)):
        table.add_column(head, justify="left" if not head else "right")
    found: dict[str, tuple[Spent | None, Spent | None]] = {}
    with tempfile.TemporaryDirectory() as folder:
        caches = Path(folder) / "caches"
        old = (
            Tree(copy_of(given.against, Path(folder)), caches / "against")
            if given.against
            else None
        )
        new = Tree(HERE, caches / "now")
        for key in given.rows.split(","):
            row = ROWS[key]
            then = old.measure(key, given) if old else None
            now = new.measure(key, given)
            cells = [
                then.shown if then else "",
                now.shown if now else "failed",
                ratio_of(row, then, now),
            ]
            table.add_row(row.name, row.aim, *(cells if old else cells[1:2]))
            print(row.name, *cells, sep=" | ", flush=True)
            found[key] = then, now
    Console(width=150).print(table)
    if given.markdown:
        given.markdown.write_text(markdown(found, label), encoding="utf-8")
    if given.json:
        rows = {
            key: {"then": then and asdict(then), "now": now and asdict(now)}
            for key, (then, now) in found.items()
        }
        given.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
