"""Public names of the package, modules that it loads, and the content of its wheel."""

import ast
import json
import re
import runpy
import subprocess
import sys
import zipfile
from pathlib import Path

import gymnasium as gym
import pytest
import yaml

import mtp_bench
from mtp_bench.core import bundle as _bundle

PUBLIC = {
    "Action", "ActionError", "Agent", "Card", "CardError", "DataError", "Detections", "Forecasts", "Frame",
    "FunctionPredictor", "MTPEnv", "MtpBenchError", "Objects", "Observation", "Pipeline", "Predictor", "RecordError",
    "Report", "Rollout", "RolloutError", "Sampler", "Scene", "ShapeError", "Submission", "SubmissionError", "Task",
    "Tracker", "Tracks", "Truth", "UnknownNameError", "__version__", "card_ids", "check_agent", "compare",
    "doctor", "evaluate", "import_forecasts", "robustness", "load_card", "load_scenes", "load_submission", "make_action", "run", "save_scene", "score", "windows",
}  # fmt: skip
LAZY = {"prediction", "scoring", "tracking", "training", "wrappers"}
SLOW = {"torch", "rerun", "highway_env", "sklearn", "numba", "scipy", "joblib", "rich", "typer", "pandas", "matplotlib"}
SLOW |= {"stable_baselines3", "jinja2", "pygame", "safetensors", "PIL", "av"}

MOST_BYTES = 5_000_000  # of the wheel


def python(code: str, *arguments: str) -> str:
    command = [sys.executable, "-c", code, *arguments]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_the_public_names_are_exactly_these() -> None:
    assert {*vars(mtp_bench)["__all__"]} == PUBLIC | LAZY
    assert {*dir(mtp_bench)} >= PUBLIC | LAZY
    assert all(getattr(mtp_bench, name).__name__ == name for name in PUBLIC - {"Action", "Observation", "__version__"})


def test_parts_are_imported_when_they_are_used() -> None:
    """Modules with the names of functions are parts of packages, not attributes of the whole."""
    out = python(
        "import sys, mtp_bench\n"
        f"names = {sorted(LAZY)}\n"
        "print(sorted(name for name in names if f'mtp_bench.{name}' in sys.modules))\n"
        "print([getattr(mtp_bench, name).__name__.removeprefix('mtp_bench.') for name in names] == names)\n"
        "import mtp_bench.running.playing, mtp_bench.scoring.score, mtp_bench.running.comparison, mtp_bench.commands.app\n"
        "print(all(callable(getattr(mtp_bench, name)) for name in ('run', 'score', 'compare')))"
    )
    assert out.splitlines() == ["[]", "True", "True"]


def test_the_judge_loads_no_reader_of_pickles() -> None:
    """Not even the restricted one: neither with all of the judge, nor with the forms of all sources."""
    out = python(
        "import importlib, pkgutil, sys\n"
        "import mtp_bench.judge as judge, mtp_bench.viz.board as board\n"
        "from mtp_bench.sources import forecast_forms, package_of\n"
        "from mtp_bench import card_ids, load_card\n"
        "for part in (judge, board):\n"
        "    for module in pkgutil.walk_packages(part.__path__, f'{part.__name__}.'):\n"
        "        if not module.name.endswith('_main'):\n"
        "            importlib.import_module(module.name)\n"
        "import mtp_bench.commands.submit, mtp_bench.commands.board, mtp_bench.commands.import_\n"
        "print(sum(len(forecast_forms(package_of(load_card(name)))) for name in card_ids()) > len(card_ids()))\n"
        "print(sorted(name for name in sys.modules if 'restricted_pickle' in name))"
    )
    assert out.splitlines() == ["True", "[]"]


def test_the_import_loads_nothing_heavy() -> None:
    out = python("import json, sys, mtp_bench\nprint(json.dumps([name.split('.')[0] for name in sys.modules]))")
    loaded = set(json.loads(out.splitlines()[-1]))
    assert "mtp_bench" in loaded
    assert not loaded & SLOW


def test_every_card_is_registered_once() -> None:
    assert {env_id for env_id in gym.registry if env_id.startswith("MTP-")} == set(mtp_bench.card_ids())
    out = python(
        "import warnings; warnings.simplefilter('error')\n"
        "import importlib, mtp_bench; importlib.reload(mtp_bench)\n"
        "import gymnasium; print(gymnasium.spec('MTP-KITTI-v0').to_json())"
    )
    spec = json.loads(out)
    assert (spec["entry_point"], spec["kwargs"]) == ("mtp_bench:MTPEnv", {"card": "MTP-KITTI-v0"})


def test_the_version_is_the_same_everywhere(repository: Path) -> None:
    version = mtp_bench.__version__
    assert f"\nversion: {version}\n" in (repository / "CITATION.cff").read_text()
    assert f"\n## [{version}]" in (repository / "CHANGELOG.md").read_text()


def test_baselines_use_public_names_only(repository: Path) -> None:
    for path in sorted((repository / "baselines").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "mtp_bench":
                names = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [part for alias in node.names for part in alias.name.split(".")]
            else:
                continue
            assert not [name for name in names if name.startswith("_")], f"{path}, line {node.lineno}"


@pytest.fixture(scope="module")
def wheel(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    result = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    (path,) = folder.glob("*.whl")
    return path


def files_under(folder: Path) -> set[str]:
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    # the rollouts beside a record never leave this machine
    return {path.as_posix() for path in paths if not any(re.search(r"__pycache__|\.rollouts$", p) for p in path.parts)}


def test_the_wheel_has_one_top_level_name(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names} == {"mtp_bench", f"mtp_bench-{mtp_bench.__version__}.dist-info"}


def test_the_wheel_holds_the_library_and_its_bundle(wheel: Path, repository: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {f"mtp_bench/{name}" for name in files_under(repository / "mtp_bench")} <= names
    for kind in ("envs", "baselines"):
        assert {f"mtp_bench/_bundled/{kind}/{name}" for name in files_under(repository / kind)} <= names
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]
    assert wheel.stat().st_size <= MOST_BYTES


def test_records_and_secrets_stay_out_of_the_wheel(repository: Path, tmp_path: Path) -> None:
    public = ["keys/allowed_signers", "owners.toml", "seals/a.commitment.json"]
    records = ["records/mine/MTP-KITTI-v0.json", "records/mine/MTP-KITTI-v0.rollouts/seed-0/run.json"]
    secret = ["keys/me", "seals/a.json", "seals/a.weights.json", *records]
    for name in (*public, *secret):
        path = tmp_path / "leaderboard" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    hook = runpy.run_path(str(repository / "hatch_build.py"))["LeaderboardHook"]
    data: dict[str, dict[str, str]] = {"force_include": {}}
    hook(str(tmp_path), {}, None, None, "", "wheel").initialize("standard", data)
    names = sorted(data["force_include"].values())
    assert names == [f"mtp_bench/_bundled/leaderboard/{name}" for name in public]


def test_the_installed_wheel_works_without_the_checkout(wheel: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target"]
    subprocess.run([*command, str(tmp_path), str(wheel)], check=True)
    out = python(
        "import json, sys; sys.path.insert(0, sys.argv[1]); import mtp_bench\n"
        "from mtp_bench.core.bundle import baseline_names, bundled\n"
        "card = mtp_bench.load_card('MTP-KITTI-v0')\n"
        "print(json.dumps([mtp_bench.__file__, str(bundled('envs')), card.digest, mtp_bench.card_ids(), "
        "baseline_names(), [mtp_bench.load_submission(name).digest for name in baseline_names()]]))",
        str(tmp_path),
    )
    file, envs, digest, ids, baselines, digests = json.loads(out)
    assert Path(file).is_relative_to(tmp_path)
    assert Path(envs).is_relative_to(tmp_path)
    assert (digest, tuple(ids)) == (mtp_bench.load_card("MTP-KITTI-v0").digest, mtp_bench.card_ids())
    assert tuple(baselines) == _bundle.baseline_names()
    assert digests == [mtp_bench.load_submission(name).digest for name in _bundle.baseline_names()]


def test_only_a_release_that_is_switched_on_is_published(repository: Path) -> None:
    """No token: the step that publishes has an identity of its own, and no other step may do it."""
    workflow = yaml.safe_load((repository / ".github" / "workflows" / "release.yml").read_text())
    build, publish = workflow["jobs"]["build"], workflow["jobs"]["publish"]
    assert workflow[True] == {"push": {"tags": ["v*"]}}, "YAML reads the key `on` as true"
    assert workflow["permissions"] == {"contents": "read"}
    assert "permissions" not in build
    assert (publish["needs"], publish["if"]) == ("build", "vars.PUBLISH == 'true'")
    assert publish["permissions"] == {"id-token": "write"}
    assert "secrets." not in (repository / ".github" / "workflows" / "release.yml").read_text()
