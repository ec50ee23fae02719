"""A submit that does not come to its end: killed, interrupted, on a full disk, twice at once."""

import hashlib
import json
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.core.parallel import Workers
from mtp_bench.judge import SceneRun, load_record, run_isolated_scenes, submit
from mtp_bench.judge.records import running, submitting
from mtp_bench.judge.records.parts import count_parts
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run
from mtp_bench.sources.cache import read_arrays, write_arrays
from tests.support.command_line import CommandLine, plain_environment, write_submission
from tests.support.disks import mounted
from tests.support.runs import remembered_reference
from tests.support.small_scenes import CARD_ID, write_kitti

pytestmark = pytest.mark.usefixtures("light_fork_servers")

SEEDS = (0, 1)
NAMES = ("0001", "0006", "0008")
SCENES = len(NAMES) * len(SEEDS)  # files of parts of a whole submit
RECORD = f"{CARD_ID}.json"
WEIGHTS = "MTP_BENCH_TESTS_WEIGHTS"  # names the file of event weights for commands in processes of their own
LIGHT = """
import os, pickle
from pathlib import Path
from mtp_bench.judge.gateway import fork_server, layout
from mtp_bench.judge.records import submitting
fork_server.LOADED = ("mtp_bench.agent.loader",)
layout._kernels = lambda: []  # else their compiler is loaded, and no agent here tracks
submitting.reference_for = lambda *_: pickle.loads(Path(os.environ["{weights}"]).read_bytes())
from mtp_bench.commands.app import main
main()
""".replace("{weights}", WEIGHTS)
EARLY = """
import os, sys
from pathlib import Path
step, left = sys.argv.pop(1), [int(sys.argv.pop(1))]
real = getattr(Path, step)
def replaced(self, target):
    if str(target).count({name!r}) and not str(target).count("/{name}.part/"):
        left[0] -= 1
        if left[0] < 0:
            os._exit(9)  # as by SIGKILL: nothing is tidied up
    return real(self, target)
setattr(Path, step, replaced)
""".replace("{name!r}", repr(CARD_ID)).replace("{name}", CARD_ID)


@pytest.fixture(scope="module")
def submission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_submission(
        tmp_path_factory.mktemp("submissions") / "echo", tables="[parameters]\nnoise = 0.1\n", body="time.sleep(0.02)"
    )


@pytest.fixture(scope="module", autouse=True)
def weights(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> Iterator[None]:
    """Made once, here: to load a tracker and its kernels is most of what a command costs otherwise."""
    file = tmp_path_factory.mktemp("weights") / "small.pickle"
    file.write_bytes(pickle.dumps(remembered_reference(load_card(card), NAMES, RunOptions(kitti))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(submitting, "reference_for", remembered_reference)
        patch.setenv(WEIGHTS, str(file))
        yield


@pytest.fixture(scope="module", autouse=True)
def _imports(submission: Path) -> None:
    agent = submission / "agent.py"
    agent.write_text(agent.read_text().replace("import numpy", "import time\nimport numpy", 1))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, submission: Path, card: str, kitti: str) -> str:
    return submit(submission, card, RunOptions(kitti, seeds=SEEDS), tmp_path_factory.mktemp("whole")).digest


@pytest.fixture(scope="module")
def to(submission: Path, card: str, kitti: str) -> Callable[[Path], list[str]]:
    common = ["submit", str(submission), "--env", card, "--data", kitti, "--seeds", str(len(SEEDS)), "--jobs", "1"]
    return lambda folder: [*common, "-o", str(folder)]


@pytest.fixture
def command(to: Callable[[Path], list[str]], tmp_path: Path) -> list[str]:
    """The arguments of a submit to ``tmp_path / "out"``."""
    return to(tmp_path / "out")


def start(command: list[str], *before: str) -> subprocess.Popen[str]:
    """The command in a session of its own, which Ctrl-C reaches also where tests run in the background of a shell."""
    inherited = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            [sys.executable, *(before or ("-c", LIGHT)), *command], stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True, start_new_session=True, env=plain_environment(),
        )  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, inherited)


def kill(process: subprocess.Popen[str]) -> None:
    """End a command and its workers at once; its agents end as they lose it."""
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def wait_for_parts(process: subprocess.Popen[str], target: Path, least: int) -> None:
    while count_parts(target) < least:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def content(folder: Path) -> dict[str, str]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and ".part" not in str(path)]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_kills_at_random_moments(cli: CommandLine, command: list[str], undisturbed: str, tmp_path: Path) -> None:
    target, moments = tmp_path / "out" / RECORD, random.Random(7)
    for at in (0, 2, 4):
        process = start([*command, "--resume"])
        wait_for_parts(process, target, at)
        time.sleep(moments.uniform(0.0, 0.4))
        kill(process)
        assert not target.exists()
    assert 4 <= count_parts(target) <= SCENES
    cli.ok(*command, "--resume")
    assert load_record(target).digest == undisturbed
    assert [path.name for path in sorted(target.parent.iterdir())] == [RECORD, f"{CARD_ID}.rollouts"]


def test_a_kill_of_several_workers(cli: CommandLine, command: list[str], undisturbed: str, tmp_path: Path) -> None:
    command[command.index("--jobs") + 1] = "2"
    target = tmp_path / "out" / RECORD
    process = start(command)
    wait_for_parts(process, target, 2)
    kill(process)
    cli.ok(*command, "--resume")
    assert load_record(target).digest == undisturbed


@pytest.mark.parametrize(
    ("step", "after"), [("replace", 0), ("rename", 0), ("rename", 1), ("rename", 2)],
    ids=["record", "rollouts of seed 0", "earlier rollouts away", "new rollouts in place"],
)  # fmt: skip
def test_a_kill_between_two_steps_of_the_end_is_finished(
    step: str, after: int, cli: CommandLine, command: list[str], undisturbed: str, tmp_path: Path
) -> None:
    target = tmp_path / "out" / RECORD
    cli.ok(*command, "--scenes", 1)
    process = start([step, str(after), *command], "-c", EARLY + LIGHT)
    process.communicate()
    assert (process.returncode, count_parts(target)) == (9, SCENES)
    cli.ok(*command, "--resume")
    assert load_record(target).digest == undisturbed
    assert [len(load_run(target.with_suffix(".rollouts") / f"seed-{seed}").rollouts) for seed in SEEDS] == [3, 3]
    assert [path.name for path in sorted(target.parent.iterdir())] == [RECORD, f"{CARD_ID}.rollouts"]


def test_ctrl_c_keeps_what_is_finished(cli: CommandLine, command: list[str], undisturbed: str, tmp_path: Path) -> None:
    target = tmp_path / "out" / RECORD
    process = start(command)
    wait_for_parts(process, target, 2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate()
    assert process.returncode == 130
    assert said == "interrupted; finished scenes are kept: the same command with --resume continues\n"
    cli.ok(*command, "--resume")
    assert load_record(target).digest == undisturbed


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 1 MiB at ``tmp_path / "out"``."""
    with mounted(tmp_path / "out", "size=1m") as folder:
        yield folder


@pytest.mark.parametrize("pages", [3, 15])
def test_a_full_disk(pages: int, cli: CommandLine, command: list[str], undisturbed: str, small_disk: Path) -> None:
    """Whatever is free, at most the last steps fail; then there is space again."""
    target = small_disk / RECORD
    cli.ok(*command, "--scenes", 1)
    before = content(small_disk)
    free = shutil.disk_usage(small_disk).free
    (small_disk / "ballast").write_bytes(bytes(free - pages * 4096))
    output = cli(*command)
    (small_disk / "ballast").unlink()
    assert output.status == 1, "so much space is enough"
    assert all(each in output.error for each in ("No space left on device", "make room"))
    assert content(small_disk) == before
    assert count_parts(target) > 0 or pages < 6
    cli.ok(*command, "--resume")
    assert load_record(target).digest == undisturbed
    assert [path.name for path in sorted(small_disk.iterdir())] == [RECORD, f"{CARD_ID}.rollouts"]


def test_a_failed_submit(cli: CommandLine, command: list[str], card: str, submission: Path, tmp_path: Path) -> None:
    """The data goes away in the middle: one error that names the file."""
    cli.ok(*command)
    before = content(tmp_path / "out")
    data = Path(write_kitti(tmp_path / "data"))
    command[command.index("--data") + 1] = str(data)
    command[1] = str(write_submission(tmp_path / "echo", tables="[parameters]\nnoise = 0.2\n"))
    process = start(command)
    wait_for_parts(process, tmp_path / "out" / RECORD, 1)
    data.rename(tmp_path / "gone")
    _, said = process.communicate()
    assert process.returncode == 1
    assert said.startswith("error: ")
    assert len(said.splitlines()) == 1
    assert str(data) in said
    assert said.endswith("; the scenes finished before are kept: --resume continues\n")
    assert content(tmp_path / "out") == before
    (tmp_path / "gone").rename(data)
    cli.ok(*command, "--resume")
    assert load_record(tmp_path / "out" / RECORD).submission.parameters == {"noise": 0.2}


def test_two_at_once(cli: CommandLine, command: list[str], undisturbed: str, tmp_path: Path) -> None:
    """The second says so, and a lock of a dead process is none."""
    target = tmp_path / "out" / RECORD
    first = start(command)
    wait_for_parts(first, target, 0)
    while not (target.with_suffix(".part") / "plan.json").exists():
        assert first.poll() is None, first.communicate()
        time.sleep(0.01)
    said = cli(*command, "--resume").error
    assert said.startswith(f"{target} is being written by another process: wait for it")
    wait_for_parts(first, target, 1)
    kill(first)
    cli.ok(*command, "--resume")
    assert load_record(target).digest == undisturbed


@pytest.fixture(scope="module")
def killed(to: Callable[[Path], list[str]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output of a submit that was killed after two scenes."""
    folder = tmp_path_factory.mktemp("killed")
    process = start(to(folder))
    wait_for_parts(process, folder / RECORD, 2)
    kill(process)
    return folder


@pytest.fixture
def begun(killed: Path, tmp_path: Path) -> Path:
    """The record of such a submit, in a copy of its output that a test may go on with."""
    return Path(shutil.copytree(killed, tmp_path / "out")) / RECORD


def test_begun_work_is_not_lost_unasked(cli: CommandLine, command: list[str], begun: Path, undisturbed: str) -> None:
    found = count_parts(begun)
    said = cli(*command).error
    assert said.startswith(f"{begun.with_suffix('.part')} holds {found} finished scenes of an interrupted submit")
    assert "--resume" in said
    assert count_parts(begun) == found
    shutil.rmtree(begun.with_suffix(".part"))
    cli.ok(*command)
    assert load_record(begun).digest == undisturbed


def test_another_plan_is_told(cli: CommandLine, command: list[str], begun: Path, tmp_path: Path) -> None:
    command[command.index("--seeds") + 1] = "1"
    assert "begun with another plan: seeds is now [0], but was [0, 1]; " in cli(*command, "--resume").error
    command[command.index("--seeds") + 1] = "2"
    assert ': commit is now "0123abc", but was ""; ' in cli(*command, "--resume", "--commit", "0123abc").error
    error = cli(*command, "--resume", "--scenes", 1).error
    assert ': scenes is now ["0001"], but was ["0001", "0006", "0008"]; ' in error
    command[1] = str(write_submission(tmp_path / "other"))
    assert "begun with another plan: submission is now " in cli(*command, "--resume").error
    assert count_parts(begun) >= 2


def test_only_what_is_left_is_run_and_broken_parts_are_left(
    cli: CommandLine, command: list[str], begun: Path, undisturbed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, ran = count_parts(begun), []

    def spied(*arguments: Any, scenes: list[str], **more: Any) -> list[SceneRun]:
        ran.extend(scenes)
        return run_isolated_scenes(*arguments, scenes=scenes, **more)

    monkeypatch.setattr(running, "run_isolated_scenes", spied)
    part = begun.with_suffix(".part") / "seed-0" / "0001.npz"
    part.write_bytes(part.read_bytes()[:-40])
    cli.ok(*command, "--resume")
    assert (load_record(begun).digest, len(ran), ran[0]) == (undisturbed, SCENES - found + 1, "0001")


def test_parts_of_another_version_rerun(cli: CommandLine, command: list[str], begun: Path, undisturbed: str) -> None:
    part = begun.with_suffix(".part") / "seed-0" / "0001.npz"
    arrays = read_arrays(part)
    assert arrays is not None
    said = json.loads(str(arrays["run"]))
    said["isolation"]["filtered"] = True
    write_arrays(part, {**{k: v for k, v in arrays.items() if k != "run"}, "run": np.array(json.dumps(said))})
    cli.ok(*command, "--resume")
    assert load_record(begun).digest == undisturbed


def test_scenes_of_other_data(cli: CommandLine, command: list[str], begun: Path, kitti: str, tmp_path: Path) -> None:
    """What was finished on detections that have been replaced since is not scored beside what they are now."""
    other = tmp_path / "other"
    shutil.copytree(kitti, other)
    done = {path.stem for path in begun.with_suffix(".part").glob("seed-*/*.npz")}
    file = other / "kitti_tracking" / "detections" / "pointrcnn" / "Car" / f"{min(done)}.txt"
    file.write_text("\n".join(file.read_text().splitlines()[1:]))
    command[command.index("--data") + 1] = str(other)
    said = cli(*command, "--resume").error
    assert f"{min(done)}: its data changed after echo was run on it" in said
    assert f"delete {begun.with_suffix('.part')}" in said


def test_foreign_files_are_not_removed(cli: CommandLine, command: list[str], tmp_path: Path) -> None:
    folder = tmp_path / "out" / f"{CARD_ID}.part"
    folder.mkdir(parents=True)
    (folder / "thesis.tex").touch()
    cli.ok(*command)
    assert [path.name for path in folder.iterdir()] == ["thesis.tex"]


def test_a_whole_record_is_not_made_again(cli: CommandLine, command: list[str], tmp_path: Path) -> None:
    cli.ok(*command)
    before = (tmp_path / "out" / RECORD).stat()
    cli.ok(*command, "--resume")
    after = (tmp_path / "out" / RECORD).stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    cli.ok(*command, "--resume", "--commit", "0123abc")
    assert load_record(tmp_path / "out" / RECORD).submission.commit == "0123abc"


def test_the_other_envs_are_run_when_one_fails(cli: CommandLine, command: list[str], card: str, tmp_path: Path) -> None:
    elsewhere = tmp_path / "MTP-Other-v0.toml"
    text = Path(card).read_text().replace(CARD_ID, "MTP-Other-v0")
    elsewhere.write_text(text.replace('name = "kitti"', 'name = "mot3d"\nsequence = "PETS09-S2L1"'))
    command[command.index("--env") : command.index("--env")] = ["--env", str(elsewhere)]
    output = cli(*command)
    assert output.status == 1
    assert output.err.splitlines()[-1].startswith(f"error: {elsewhere}: ")
    assert load_record(tmp_path / "out" / RECORD).status == "finished"


def test_an_error_before_the_first_scene_leaves_no_parts(submission: Path, card: str, tmp_path: Path) -> None:
    """So that the next submit is not asked what to do with them."""
    data = write_kitti(tmp_path / "data")
    shutil.rmtree(tmp_path / "data" / "kitti_tracking" / "training" / "label_02")
    with pytest.raises(MtpBenchError, match="label_02"):
        submit(submission, card, RunOptions(data, workers=Workers(1)), tmp_path / "out")
    assert not (tmp_path / "out" / f"{CARD_ID}.part").exists()
