"""Submissions: read, built and kept apart."""

import importlib.util
import pickle
import py_compile
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent import SubmissionFactory, load_submission
from mtp_bench.core.bundle import baseline_names
from mtp_bench.core.errors import SubmissionError, UnknownNameError
from tests.support.small_scenes import task

TASK = task(classes=("car",), detections=5, objects=5)

MANIFEST = """
name = "silent"
authors = ["A. Author"]
agent = "agent:build"

[parameters]
gate = 1.5
"""

AGENT = """
class Silent:
    def __init__(self, task, gate, hypotheses):
        self.task, self.gate, self.hypotheses = task, gate, hypotheses

    def reset(self, task):
        pass

    def act(self, observation):
        return {}


def build(task, gate, hypotheses=1):
    return Silent(task, gate, hypotheses)
"""


def write(folder: Path, manifest: str = MANIFEST, **modules: str) -> Path:
    folder.mkdir(parents=True)
    (folder / "submission.toml").write_text(manifest)
    for name, code in ({"agent": AGENT} | modules).items():
        (folder / f"{name}.py").write_text(code)
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write(tmp_path / "silent")


def built(folder: Path, **overrides: Any) -> Any:
    """The agent, free of its type: tests look at its attributes."""
    return load_submission(folder).build(TASK, **overrides)


def test_a_submission_is_read(folder: Path) -> None:
    submission = load_submission(folder)
    assert load_submission(folder / "submission.toml") == submission
    with pytest.raises(SubmissionError, match="the submission is 3, expected its folder or the name of a baseline"):
        load_submission(3)  # type: ignore[arg-type]
    assert (submission.name, submission.authors, submission.agent) == ("silent", ("A. Author",), "agent:build")
    assert (submission.parameters, submission.path, submission.compare.sweep) == ({"gate": 1.5}, folder, {})
    assert submission.compare.samples == ("equal",)


def test_parameters_reach_the_agent_and_overrides_win(folder: Path) -> None:
    agent = built(folder, hypotheses=20)
    assert (agent.task, agent.gate, agent.hypotheses, built(folder, gate=3.0).gate) == (TASK, 1.5, 20, 3.0)


def test_modules_of_a_folder_import_each_other(tmp_path: Path) -> None:
    agent = AGENT.replace("def build", "from .model import GATE\n\ndef build").replace(
        "gate, hypotheses)\n", "GATE, 1)\n"
    )
    one = write(tmp_path / "one", agent=agent, model="GATE = 'one'")
    two = write(tmp_path / "two", agent=agent, model="GATE = 'two'")
    assert [built(one).gate, built(two).gate, built(one).gate] == ["one", "two", "one"]


def test_edited_code_is_imported_anew(folder: Path) -> None:
    before = built(folder)
    (folder / "agent.py").write_text(AGENT.replace("= task, gate", "= task, gate + 1"))
    assert built(folder).gate == before.gate + 1


def test_the_digest_covers_names_and_contents(folder: Path) -> None:
    digests = [load_submission(folder).digest]
    (folder / "weights.safetensors").write_bytes(b"12")
    digests.append(load_submission(folder).digest)
    (folder / "weights.safetensors").write_bytes(b"21")
    digests.append(load_submission(folder).digest)
    (folder / "weights.safetensors").rename(folder / "other.safetensors")
    digests.append(load_submission(folder).digest)
    (folder / "nested").mkdir()
    (folder / "other.safetensors").rename(folder / "nested" / "other.safetensors")
    digests.append(load_submission(folder).digest)
    assert len(set(digests)) == len(digests)


def test_the_digest_does_not_depend_on_place_or_use(tmp_path: Path, folder: Path) -> None:
    before = load_submission(folder).digest
    built(folder)
    (folder / "__pycache__").mkdir(exist_ok=True)
    (folder / "__pycache__" / "left.pyc").write_bytes(b"behind")
    assert (load_submission(folder).digest, load_submission(write(tmp_path / "copy")).digest) == (before, before)


def test_compiled_code_beside_the_sources_is_neither_run_nor_written(folder: Path, tmp_path: Path) -> None:
    """No digest covers it: a file that looks up to date would run in place of the source."""
    other = tmp_path / "agent.py"
    other.write_text(AGENT.replace("gate, hypotheses\n", "'forged', hypotheses\n"))
    cached = Path(importlib.util.cache_from_source(str(folder / "agent.py")))
    py_compile.compile(str(other), str(cached), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    assert built(folder).gate == 1.5
    shutil.rmtree(cached.parent)
    (folder / "late.py").write_text("GATE = 2.5")
    agent = AGENT.replace("        return {}", "        from . import late\n\n        return {}")
    (folder / "agent.py").write_text(agent)
    built(folder).act({})
    assert sorted(path.name for path in folder.iterdir()) == ["agent.py", "late.py", "submission.toml"]


@pytest.mark.parametrize("name", ["__pycache__", "__pycache__.hidden"])
def test_modules_that_no_digest_covers_are_not_imported(name: str, folder: Path) -> None:
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "hidden.py").write_text("GATE = 1")
    (folder / "agent.py").write_text(f"import importlib\nimportlib.import_module('.{name}', __package__)\n{AGENT}")
    with pytest.raises(SubmissionError, match="is not part of a submission"):
        built(folder)


def test_a_factory_works_in_another_process(folder: Path) -> None:
    factory = SubmissionFactory(str(folder), {"hypotheses": 7})
    assert factory(TASK) is not factory(TASK), "agents share nothing"
    assert len(pickle.dumps(factory)) < 1000, "workers get the path, not the agent"
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert pool.submit(hypotheses_of, factory).result() == 7


def test_an_agent_cannot_change_the_parameters_of_the_next(folder: Path) -> None:
    factory = SubmissionFactory(str(folder), {"hypotheses": [7]})
    first: Any = factory(TASK)
    first.hypotheses.append(8)
    second: Any = factory(TASK)
    assert second.hypotheses == [7]


def hypotheses_of(factory: SubmissionFactory) -> int:
    agent: Any = factory(TASK)
    return int(agent.hypotheses)


WRONG_MANIFEST = {
    "typo": (MANIFEST.replace("authors", "author"), "unknown key 'author': did you mean 'authors'?"),
    "the name of a folder of rollouts": (
        MANIFEST.replace('"silent"', '"mine.rollouts"'), "no .part or .rollouts at the"),
    "an agent outside": (MANIFEST.replace("agent:build", "../agent:build"), "agent: got '../agent:build'"),
    "an agent that is not there": (MANIFEST.replace("agent:build", "agnet:build"), "there is no "),
    "a count that is no parameter": (MANIFEST + "[compare]\ndraws = 'gat'", "compare.draws: unknown parameter 'gat'"),
    "unknown budget": (MANIFEST + "[compare]\nsamples = ['fair']", "'equal' or 'free'"),
}  # fmt: skip


@pytest.mark.parametrize(("manifest", "text"), WRONG_MANIFEST.values(), ids=WRONG_MANIFEST)
def test_a_wrong_manifest_is_one_clear_error(tmp_path: Path, manifest: str, text: str) -> None:
    folder = write(tmp_path / "wrong", manifest)
    with pytest.raises(SubmissionError) as caught:
        load_submission(folder)
    assert all(each in str(caught.value) for each in ("wrong/submission.toml", text))


WRONG_CODE = {
    "syntax": ("def build(:", "importing agent.py failed: SyntaxError"),
    "sibling by absolute import": ("import model", "write `from .model import ...`"),
    "no agent": ("def build(task, gate):\n    return 3", "returned 'int' without reset and act"),
    "half an agent": (AGENT.replace("def act", "def akt"), "returned 'Silent' without act"),
    "no parameter": ("def build():\n    return 3", "build takes no parameters, expected the task"),
    "a parameter without value": (AGENT.replace("hypotheses=1", "hypotheses"), "parameter 'hypotheses' has no value"),
}


@pytest.mark.parametrize(("code", "text"), WRONG_CODE.values(), ids=WRONG_CODE)
def test_wrong_code_is_one_clear_error(tmp_path: Path, code: str, text: str) -> None:
    folder = write(tmp_path / "wrong", agent=code, model="")
    with pytest.raises(SubmissionError) as caught:
        load_submission(folder).build(TASK)
    assert text in str(caught.value)


def test_an_unknown_parameter_or_function_names_the_nearest(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"parameter of silent 'hypothesis': did you mean 'hypotheses'\?"):
        built(folder, hypothesis=5)
    with pytest.raises(UnknownNameError, match=r"'built': did you mean 'build'\? \(the name behind ':' in agent"):
        built(write(tmp_path / "wrong", MANIFEST.replace(":build", ":built")))


@pytest.mark.parametrize("name", baseline_names())
def test_every_baseline_is_a_submission(name: str) -> None:
    submission = load_submission(name)
    assert submission.name == name
    task = replace(TASK, detector="pointrcnn", observe=submission.compare.observe, lanes=9)
    agent = submission.build(task)
    try:
        agent.reset(task)
    except SubmissionError as error:
        assert "mtp-bench train predictor" in str(error)  # noqa: PT017  (a network is not trained for a made-up env)
    pair = submission.compare.gap_references
    if submission.networks and submission.compare.observe == "detections":
        assert isinstance(pair, dict), "its gap is between references with its own predictor"
        assert submission.build(replace(task, observe="truth"), **pair)
