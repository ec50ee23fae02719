"""Commands that are killed at random moments: what they leave behind, and what the next start makes of it.

SOAK_KILLS=60 pytest -s tests/adversarial/test_soak.py   more kills, and their table
"""

import contextlib
import getpass
import hashlib
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from mtp_bench.cards import load_card
from mtp_bench.env import digest
from mtp_bench.judge import load_record
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run
from tests.adversarial.test_resume import LIGHT, NAMES, WEIGHTS
from tests.support.command_line import plain_environment, write_submission
from tests.support.runs import remembered_reference

KILLS = int(os.environ.get("SOAK_KILLS", "20"))
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)
SECONDS = {"submit": 6.0, "run": 4.0, "compare": 7.0, "train": 7.0}  # within which a kill comes
IMAGE_SECONDS = 100  # after which the folder of a killed judge is removed by the next one


class Soak:
    """Four commands on the small scenes, in a folder with temporary files of their own."""

    def __init__(self, folder: Path, agent: Path, card: str, data: str, weights: Path) -> None:
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        common = ["--env", card, "--data", data, "--jobs", "2"]
        self.out = {name: folder / name for name in SECONDS}
        self.words = {
            "submit": ["submit", str(agent), *common, "--seeds", "2", "--resume", "-o", str(self.out["submit"])],
            "run": ["run", str(agent), *common, "--force", "-o", str(self.out["run"])],
            "compare": ["compare", str(agent), *common, "--no-times", "--json", str(self.out["compare"])],
            "train": [
                "train",
                "predictor",
                "modes",
                *common,
                "--split",
                "val",
                "--epochs",
                "2",
                "-o",
                str(self.out["train"]),
            ],
        }
        self.environment = {
            **plain_environment(), "TMPDIR": str(self.temporary), WEIGHTS: str(weights),
        }  # fmt: skip

    def start(self, name: str) -> subprocess.Popen[str]:
        inherited = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return subprocess.Popen(
                [sys.executable, "-c", LIGHT, *self.words[name]], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                text=True, start_new_session=True, env=self.environment,
            )  # fmt: skip
        finally:
            signal.signal(signal.SIGINT, inherited)

    def result(self, name: str) -> str:
        """What the command made, without times."""
        out = self.out[name]
        if name == "submit":
            return load_record(next(out.glob("*.json"))).digest
        if name == "run":
            return " ".join(digest(rollout) for rollout in load_run(out).rollouts)
        if name == "train":
            return hashlib.sha256(out.read_bytes()).hexdigest()
        return out.read_text()

    def processes(self, session: int) -> list[int]:
        """Living processes of a session, or of a sandbox that shows our temporary files."""
        pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
        return [pid for pid in pids if self._is_ours(pid, session)]

    def _is_ours(self, pid: int, session: int) -> bool:
        with contextlib.suppress(OSError):
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            shown = Path(f"/proc/{pid}/cmdline").read_bytes()
            return state[0] != "Z" and (int(state[3]) == session or str(self.temporary).encode() in shown)
        return False

    def workers(self, session: int) -> Sequence[int]:
        found = []
        for pid in self.processes(session):
            with contextlib.suppress(OSError):
                if b"LokyProcess" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    found.append(pid)
        return found


@pytest.fixture
def soak(tmp_path: Path, card: str, kitti: str) -> Soak:
    weights = tmp_path / "weights.pickle"
    weights.write_bytes(pickle.dumps(remembered_reference(load_card(card), NAMES, RunOptions(kitti))))
    agent = write_submission(tmp_path / "echo", body="time.sleep(0.05)")
    file = agent / "agent.py"
    file.write_text(file.read_text().replace("import numpy", "import time\nimport numpy", 1))
    return Soak(tmp_path, agent, card, kitti, weights)


def test_kills(soak: Soak) -> None:
    """Nothing lives on, and the next start finishes with what an undisturbed one makes."""
    moments = random.Random(11)
    expected = {}
    for name in SECONDS:
        process = soak.start(name)
        _, said = process.communicate()
        assert process.returncode == 0, said
        expected[name] = soak.result(name)
    shutil.rmtree(soak.out["submit"])  # a finished record would be left as it is
    for number in range(KILLS):
        name = list(SECONDS)[number % len(SECONDS)]
        kind = moments.choice(SIGNALS)
        process = soak.start(name)
        seconds = moments.uniform(0.2, SECONDS[name])
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        workers = soak.workers(process.pid)
        target = moments.choice(workers) if workers and moments.random() < 0.5 else process.pid
        with contextlib.suppress(ProcessLookupError):
            os.kill(target, kind)
        said = process.communicate()[1]
        print(f"{number:3d} {name:8s} {seconds:4.1f} s {kind.name:7s} {'parent' if target == process.pid else 'worker'}: "
              f"{process.returncode} {said.splitlines()[-1] if said else ''}"[:150])  # fmt: skip
        if target == process.pid:
            # -N, which a shell shows as 128 + N, while Python still starts
            assert process.returncode in {0, 128 + kind, -kind}
        assert "Traceback" not in said or process.returncode == -signal.SIGINT
        deadline = time.monotonic() + 10
        while soak.processes(process.pid):
            assert time.monotonic() < deadline, "processes live on"
            time.sleep(0.1)
    for path in soak.temporary.iterdir():
        os.utime(path, (time.time() - IMAGE_SECONDS,) * 2)
    for name in ("run", "compare", "train", "submit"):
        process = soak.start(name)
        _, said = process.communicate()
        assert process.returncode == 0, said
        assert soak.result(name) == expected[name]
    assert {path.name for path in soak.temporary.iterdir()} <= {f"torchinductor_{getpass.getuser()}"}
