"""What the process of an agent is given and what it must not see."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

from ..errors import SubmissionError
from ..files import WEIGHTS_VARIABLE, weights_folder
from ..sources.cache import cache_root
from ..sources.dataset import data_root
from ..submission.loader import Submission

_KERNELS = {  # those that baselines need
    "tracking.kernels.association": ("search",),
    "tracking.kernels.affinity_kernels": ("sparse_pairs",),
    "tracking.kernels.tree_kernels": ("grow", "distinct_rows", "descend", "histories"),
    "tracking.kernels.motion_kernels": ("predict", "update_pairs"),
    "prediction.kalman": ("filter_pasts",),
    "prediction.kinematic": ("expand",),
    "prediction.greedy": ("k_medians",),
    "prediction.k_means": ("k_means",),
}
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
_PASSED = ("LD_LIBRARY_PATH", "CUDA_VISIBLE_DEVICES", "NUMBA_DISABLE_JIT", *_THREADS)


def own_kernels() -> str | None:
    """Folder of the user's compiled kernels; None where there is none yet."""
    from platformdirs import user_cache_path

    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(given) if given else user_cache_path("mtp_bench", appauthor=False)
    return str(folder.resolve()) if folder.is_dir() else None


def compile_kernels() -> None:
    """Fill the user's cache of compiled kernels, which every agent reads: what an agent compiles is lost with it."""
    for module, names in _KERNELS.items():
        loaded = importlib.import_module(f"mtp_bench.{module}")
        for name in names:
            getattr(loaded, name).compiled()


def library_path() -> list[str]:
    """Where the agent finds this library, and other packages that an isolated interpreter would not see."""
    spec = importlib.util.find_spec(__name__.partition(".")[0])
    root = str(Path(str(spec and spec.origin)).resolve().parent.parent)
    return [root, *(entry for entry in sys.path if entry.endswith(("site-packages", "dist-packages")))]


def environment(work: str, kernels: str) -> dict[str, str]:
    """Environment of an agent's process: of the judge's own, only what libraries need."""
    own = {"HOME": work, "TMPDIR": work, "LANG": "C.UTF-8", "NUMBA_CACHE_DIR": kernels}
    if weights_folder().is_dir():  # of networks that were trained here: the agent's home is another
        own[WEIGHTS_VARIABLE] = str(weights_folder())
    return {name: os.environ[name] for name in _PASSED if name in os.environ} | own


def hidden_folders(submission: Submission, data: str | None) -> list[str]:
    """Folders that the agent must not see: the data, and the scenes made of it or generated.

    And folders of the submission that its digest does not cover: compiled code would run in place of its own.

    Raises SubmissionError where one of them holds the submission or the library.
    """
    cache = cache_root()
    made = [path for path in cache.iterdir() if not path.name.startswith("kernels-")] if cache.is_dir() else []
    found = [path.resolve() for path in (data_root(data)[0], data_root(None)[0], *made) if path.is_dir()]
    hidden = [path for path in dict.fromkeys(found) if not set(found) & set(path.parents)]
    library = Path(library_path()[0])
    for path in hidden:
        for needed, what in ((submission.path, "submission"), (library, "library")):
            if needed == path or path in needed.parents:
                raise SubmissionError(
                    f"{path} holds data and the {what} ({needed}): an agent must not see the data; move one"
                )
    return [os.fspath(path) for path in (*hidden, *_beside_the_digest(submission.path))]


def _beside_the_digest(folder: Path) -> list[Path]:
    """Outermost folders of a submission that its digest does not cover."""
    found = {path for name in ("__pycache__", ".git") for path in folder.rglob(name) if path.is_dir()}
    return sorted(path for path in found if not found & set(path.parents))
