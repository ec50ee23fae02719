"""`mtp-bench check`: what it prints of sound and of broken submissions, and its exit status."""

from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent.submission_files import new_submission
from mtp_bench.core import Rollout
from mtp_bench.judge import SceneRun
from mtp_bench.judge.records.checking import gateway_findings
from tests.support.command_line import CommandLine, read_json
from tests.support.runs import run_scenes
from tests.support.small_scenes import make_echo

pytestmark = pytest.mark.usefixtures("light_fork_servers")
ACT = '        """Answer this frame, before the next one is known."""\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return new_submission("mine", tmp_path)


def edit(folder: Path, old: str, new: str, file: str = "agent.py") -> None:
    path = folder / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_sound_submission_passes(folder: Path, cli: CommandLine, tmp_path: Path) -> None:
    out = cli.ok("check", folder, "--scenes", 1, "--json", tmp_path / "check.json")
    assert all(text in out for text in ("mine on MTP-Intersection-v0", "mine passes; next: `mtp-bench compare"))
    content = read_json(tmp_path / "check.json")
    assert {finding["level"] for finding in content["findings"]} == {"ok"}
    assert [finding["check"] for finding in content["findings"]][-1] == "gateway"


def test_what_only_the_gateway_sees(folder: Path, cli: CommandLine) -> None:
    edit(folder, ACT, ACT + "        import os\n        if 'HOME' not in os.environ and 'PATH' not in os.environ or "
         "os.environ.get('CHECK_ME') is None:\n            raise RuntimeError('no environment')\n")  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CHECK_ME", "1")
        output = cli("check", folder, "--scenes", 1)
    assert output.error == "mine does not pass: 1 error, see the table"
    assert all(text in output.out for text in ("crashed", "no environment"))


UNSAFE = {
    "ends its process": ("import os; os._exit(0)", "crashed: the process "),
    "a fault": ("import ctypes; ctypes.string_at(0)", "crashed: the process "),
}


@pytest.mark.parametrize(("body", "text"), UNSAFE.values(), ids=UNSAFE)
def test_an_agent_that_ends_its_process_is_not_run_here(body: str, text: str, folder: Path, cli: CommandLine) -> None:
    edit(folder, ACT, f"{ACT}        {body}\n")
    output = cli("check", folder, "--scenes", 1)
    assert output.status == 1
    assert text in output.out
    assert "conformance" not in output.out


def run(rollout: Rollout, **changes: Any) -> SceneRun:
    told: dict[str, Any] = {"status": "finished", "reason": "", "malformed": 0, "seal": ""}
    return SceneRun(rollout=rollout, **(told | {"peak_memory": 3 << 20, "started": 0.25} | changes))


def test_what_the_gateway_says_becomes_findings(card: str, kitti: str) -> None:
    one, two = run_scenes(make_echo, card, {"data": kitti}, ["0001", "0006"])
    (sound,) = gateway_findings([run(one), run(two)], [one, two])
    assert (sound.level, sound.got) == ("ok", "2 scenes in a process of its own: 3 MiB at most")
    found = gateway_findings([run(one), run(two, malformed=1, status="hung", reason="no answer")], [one, one])
    assert [finding.got for finding in found] == ["hung: no answer", "1 answers malformed"]
    assert {(finding.level, finding.where) for finding in found} == {("error", "scene 0006")}
    (other,) = gateway_findings([run(one)], [two])
    assert (other.level, other.got, other.where) == ("warning", "answers differ in a process of its own", "scene 0001")
