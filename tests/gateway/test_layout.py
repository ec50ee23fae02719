"""What an agent sees, the image that it runs from, and the groups that hold its memory."""

import errno
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib.util import cache_from_source, source_from_cache
from pathlib import Path

import pytest
from filelock import FileLock

from mtp_bench.agent import load_submission
from mtp_bench.agent.submission_files import files_of
from mtp_bench.commands.output import error_text
from mtp_bench.core.errors import MtpBenchError, SubmissionError
from mtp_bench.core.networks import WEIGHTS_VARIABLE, file_name
from mtp_bench.judge import run_isolated
from mtp_bench.judge.gateway import sandbox
from mtp_bench.judge.gateway.layout import LIBRARY, _new_folder, environment, image_of, layout_for, library, python
from mtp_bench.judge.gateway.processes import Group, _places, make_group
from mtp_bench.tracking.kernels.cache import cache_folder
from tests.support.hostile import MANIFEST, QUICK, SCENE, submission
from tests.support.own_scenes import write_long_log

IMPORTS = """
import importlib, pkgutil, sys
import mtp_bench
for name in ("core", "agent", "tracking", "prediction"):
    package = importlib.import_module(f"mtp_bench.{name}")
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(found.name)
mtp_bench.make_action, mtp_bench.load_submission
print(*(m.__file__ for n, m in sys.modules.items() if n.startswith("mtp_bench") and m.__file__), sep="\\n")
"""


def test_the_part_of_the_library_that_players_need_is_shown() -> None:
    package = library() / "mtp_bench"
    shown = [package / part for part in LIBRARY]
    assert all(path.exists() for path in shown)
    printed = subprocess.run([sys.executable, "-c", IMPORTS], capture_output=True, text=True, check=True)
    needed = [Path(line) for line in printed.stdout.split()]
    assert len(needed) > 50
    assert [path for path in needed if not any(path.is_relative_to(part) for part in shown)] == []


def test_nothing_of_the_judge_is_shown(tmp_path: Path) -> None:
    layout = layout_for(image_of(load_submission(submission(tmp_path / "mine")), "MTP-X-v0"), None)
    places = [Path(here) for here, _ in layout.shown]
    package = library() / "mtp_bench"
    hidden = ("scoring", "sources", "judge/records", "env/environment.py", "judge/gateway/exchange.py", "_bundled")
    for part in (package / name for name in hidden):
        assert not any(part.is_relative_to(place) for place in places), part
    for part in (library() / "envs", library() / "leaderboard", Path.home(), Path("/etc/passwd"), Path("/run")):
        assert not any(part.is_relative_to(place) for place in places), part
    shown = {here for here, _ in layout.shown}
    compiled = [here for here in shown if here.endswith(".pyc")]
    assert sys.dont_write_bytecode or cache_from_source(str(library() / "mtp_bench" / "__init__.py")) in compiled
    assert {source_from_cache(here) for here in compiled} <= shown, "bytecode is that of shown modules alone"


def test_kernels_in_the_users_cache_are_no_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing is set they lie beside the generated scenes, which are one."""
    kernels = tmp_path / "cache" / "kernels-0"
    kernels.mkdir(parents=True)
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("mtp_bench.judge.gateway.layout.compiled_kernels", lambda: [kernels])
    image = image_of(load_submission(submission(tmp_path / "mine")), "MTP-X-v0")
    assert (str(kernels), "/kernels/kernels-0") in layout_for(image, None).shown


def test_kernels_are_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent does not start where the judge does."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "kernels")
    monkeypatch.chdir(tmp_path)
    assert cache_folder() == tmp_path / "kernels"
    assert environment(isolated=False)["NUMBA_CACHE_DIR"] == str(tmp_path / "kernels")


def test_data_inside_what_is_shown_is_refused(tmp_path: Path) -> None:
    """Behind a link in the data root, and the user's own files and scenes."""
    folder, root = submission(tmp_path / "mine"), tmp_path / "root"
    (folder / "kitti").mkdir()
    (tracks := folder / "tracks.json").write_text("{}")
    root.mkdir()
    (root / "kitti_tracking").symlink_to(folder / "kitti")
    image, log = image_of(load_submission(folder), "MTP-X-v0"), str(write_long_log(folder / "log", frames=20))
    with pytest.raises(SubmissionError, match="which agents see: move the data elsewhere"):
        layout_for(image, str(root))
    for own in (tracks, folder):
        with pytest.raises(SubmissionError, match=rf"{own} holds data inside .*, which agents see"):
            layout_for(image, None, own=[own])
    assert layout_for(image, None, own=[tmp_path / "elsewhere"])
    with pytest.raises(SubmissionError, match=r"log holds data inside .*mine, which agents see"):
        run_isolated(folder, "MTP-nuScenes-v0", {"files": log}, "one")


def test_an_image_is_what_its_digest_covers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = submission(tmp_path / "mine")
    (folder / "weights").mkdir()
    (folder / "weights" / "net.bin").write_bytes(b"123")
    (folder / ".git").mkdir()
    (folder / ".git" / "config").touch()
    image = image_of(load_submission(folder), "MTP-X-v0")
    assert image.digest == load_submission(folder).digest
    names = sorted(path.relative_to(image.submission).as_posix() for path in image.submission.rglob("*"))
    assert names == ["agent.py", "submission.toml", "weights", "weights/net.bin"]
    assert image_of(load_submission(folder), "MTP-X-v0") is image
    (folder / "weights" / "net.bin").write_bytes(b"1234")
    assert image_of(load_submission(folder), "MTP-X-v0").digest not in ("", image.digest)


def test_weights_that_were_trained_here_are_part_of_what_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, weights = submission(tmp_path / "mine"), tmp_path / "weights"
    weights.mkdir()
    monkeypatch.setenv(WEIGHTS_VARIABLE, str(weights))
    (folder / "submission.toml").write_text(f'{MANIFEST}networks = ["modes-truth"]\n')
    without = image_of(load_submission(folder), "MTP-Merge-v0")
    assert without.digest == load_submission(folder).digest
    for env_id in ("MTP-Highway-v0", "MTP-KITTI-v0"):
        (weights / file_name("modes", "truth", env_id)).write_bytes(b"weights")
    found = image_of(load_submission(folder), "MTP-Merge-v0", "MTP-Highway-v0")
    assert [path.name for path in found.networks.iterdir()] == [file_name("modes", "truth", "MTP-Highway-v0")]
    assert found.digest != without.digest


def test_a_full_temporary_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = load_submission(submission(tmp_path / "mine"))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(shutil, "copyfileobj", full)
    with pytest.raises(MtpBenchError, match=f"temporary files in {tempfile.gettempdir()}: No space left") as raised:
        image_of(loaded, "MTP-X-v0")
    assert "mine" not in str(raised.value)
    assert "temporary files in " in error_text(OSError(errno.ENOSPC, "No space left on device"))


def test_only_copies_of_killed_judges_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their pids say nothing: a judge may live in another namespace."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folders = {name: tmp_path / f"mtp_bench-image-{name}" for name in ("killed", "living", "begun", "unlocked")}
    for folder in folders.values():
        (folder / "submission").mkdir(parents=True)
    for name in ("killed", "living", "begun"):
        (folders[name] / "lock").touch()
    for name in ("killed", "living", "unlocked"):
        os.utime(folders[name], (0, 0))
    with FileLock(folders["living"] / "lock"):
        first = _new_folder()
        os.utime(first, (0, 0))
        second = _new_folder()
    assert {first, second, *folders.values()} - set(tmp_path.iterdir()) == {folders["killed"]}


def test_a_link_that_takes_the_place_of_a_file_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, secret = submission(tmp_path / "mine"), tmp_path / "secret"
    secret.write_text("secret")
    loaded = load_submission(folder)

    def swapped(path: Path) -> list[Path]:
        found = files_of(path)
        (path / "agent.py").unlink(missing_ok=True)
        (path / "agent.py").symlink_to(secret)
        return found

    monkeypatch.setattr("mtp_bench.judge.gateway.layout.files_of", swapped)
    with pytest.raises(SubmissionError, match=r"agent\.py: cannot be read"):
        image_of(loaded, "MTP-X-v0")


def test_files_that_change_during_a_run_are_noticed(card: str, kitti: str, tmp_path: Path) -> None:
    """By another machine, which has no copy of them."""
    folder = submission(tmp_path / "mine")
    image = image_of(load_submission(folder), "MTP-X-v0")
    elsewhere = replace(image, submission=tmp_path / "elsewhere", digest="0" * 64)
    with pytest.raises(SubmissionError, match="its files changed while it ran"):
        run_isolated(folder, card, {"data": kitti}, SCENE, limits=QUICK, image=elsewhere)
    (folder / "agent.py").write_text("raise ValueError")
    assert not run_isolated(folder, card, {"data": kitti}, SCENE, limits=QUICK, image=image).reason


@pytest.mark.parametrize("delegated", [True, False])
def test_groups_of_version_two(tmp_path: Path, delegated: bool) -> None:
    """The folders as the system shows them: limits go into a new group beside that of the judge."""
    own, place = tmp_path / "cgroup", tmp_path / "root" / "user"
    own.write_text("0::/user/judge\n")
    (place / "judge").mkdir(parents=True)
    (place / "judge" / "cgroup.subtree_control").write_text("")
    (place / "cgroup.subtree_control").write_text("cpu memory pids\n" if delegated else "cpu\n")
    places, names = _places(tmp_path / "root", own)
    assert places == ([place] if delegated else [])
    assert not delegated or {"memory.max", "pids.max"} <= names.keys()
    assert not make_group(1 << 30, 99, tmp_path / "root", own).folders  # here no system fills the folder with files
    assert [path.name for path in place.iterdir() if path.is_dir()] == ["judge"]


def test_a_group_that_was_exceeded_says_so(tmp_path: Path) -> None:
    group = Group((tmp_path,))
    assert not group.exceeded()
    (tmp_path / "memory.events").write_text("low 0\noom 1\noom_kill 0\n")
    assert not group.exceeded()
    (tmp_path / "memory.events").write_text("low 0\noom 1\noom_kill 2\n")
    assert group.exceeded()


def test_a_group_of_this_system_is_removed() -> None:
    group = make_group(1 << 30, 99)
    if not group.folders:
        pytest.skip("this system delegates no control groups")
    assert all(folder.is_dir() for folder in group.folders)
    group.remove()
    assert not any(folder.is_dir() for folder in group.folders)


def test_the_order_of_a_set_is_the_same_in_every_judge() -> None:
    program = [*python(), "-c", "print(hash('car'), list({'car', 'bus', 'bicycle', 'truck'}))"]
    found = {subprocess.run(program, env=environment(False), capture_output=True, check=True).stdout for _ in range(3)}
    assert len(found) == 1


@pytest.mark.needs("sandbox")
def test_a_busy_machine_is_no_system_without_isolation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "_TRIAL_SECONDS", 1e-4)
    with pytest.raises(SubmissionError, match="try again when the machine is less busy"):
        sandbox.bubblewrap_works()


def test_every_forbidden_call_has_a_number() -> None:
    names = " ".join([*sandbox.FORBIDDEN.values(), sandbox.PRETENDED, "fcntl futex madvise prctl clone3 clone"]).split()
    assert not [name for name in names if sandbox.call_number(name) < 0]


def test_without_libseccomp_agents_run_unsandboxed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "_libseccomp", lambda: None)
    assert sandbox.system_call_filter.__wrapped__() is None
    monkeypatch.setattr(sandbox, "system_call_filter", sandbox.system_call_filter.__wrapped__)
    assert sandbox.sandbox_backend.__wrapped__() == "none"


def test_a_rule_that_libseccomp_refuses_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "_rules", lambda: [(1, "clone", (99, 5, 0))])
    with pytest.raises(OSError, match="libseccomp: "):
        sandbox.system_call_filter.__wrapped__()
