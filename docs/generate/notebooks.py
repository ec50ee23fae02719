"""The notebooks: executed while the site is built, each a page with its outputs and a file to download.

They are kept as text (`docs/notebooks/*.py`, cells between lines with ``# %%``, as jupytext reads and writes them).
"""

from __future__ import annotations

import base64
import os
import re
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "notebooks"
NAMES = (
    "first_scene",
    "own_predictor",
    "own_tracker",
    "own_model",
    "results",
)  # as in the navigation
SECONDS = 600  # for one cell
QUIET: dict[str, Any] = {
    "extra_arguments": ["--IPKernelApp.log_level=40"]
}  # it warns of TCP, which stays on this machine
HEAD = "*This page is a notebook: [{name}.ipynb]({name}.ipynb), or as text [{name}.py]({name}.py).*"


def navigation() -> list[dict[str, str]]:
    """The pages in the order of the navigation."""
    return [{title(name): f"notebooks/{name}.md"} for name in NAMES]


def title(name: str) -> str:
    """The heading of a notebook."""
    found = re.search(
        r"^# # (.+)$", (FOLDER / f"{name}.py").read_text(), flags=re.MULTILINE
    )
    assert found, name
    return found[1]


def files() -> dict[str, str | bytes]:
    """Pages, notebooks and pictures by their places in the site."""
    import nbformat

    content: dict[str, str | bytes] = {}
    for name, notebook in executed().items():
        content[f"notebooks/{name}.ipynb"] = nbformat.writes(notebook)  # type: ignore[no-untyped-call]
        page, pictures = _page(name, notebook)
        content[f"notebooks/{name}.md"] = page
        content |= {
            f"notebooks/{place}": picture for place, picture in pictures.items()
        }
    return content


@cache
def executed() -> dict[str, Any]:
    """All notebooks with their outputs. Raises CellExecutionError for a cell that fails.

    One process runs them one after the other, each without the names of those before: a process for each would spend
    most of its time on loading libraries.
    """
    import jupytext
    from nbclient import NotebookClient

    read = {name: jupytext.read(FOLDER / f"{name}.py") for name in NAMES}
    whole = jupytext.reads("", "py:percent")
    for notebook in read.values():
        whole.cells += (
            jupytext.reads("# %%\n# %reset -f", "py:percent").cells + notebook.cells
        )
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {
        **os.environ,
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",
        "MTP_BENCH_QUIET": "1",
    }
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            whole,
            timeout=SECONDS,
            startup_timeout=SECONDS,
            kernel_name="python3",
            **QUIET,
        )
        client.resources = {"metadata": {"path": folder}}
        client.execute(env=environment)
    for notebook in read.values():
        notebook.metadata |= whole.metadata
        _number(notebook)
    return read


def _number(notebook: Any) -> None:
    """Number the cells of a notebook from 1 on, without times: the same notebook gives the same file."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(code, 1):
        cell.metadata.pop("execution", None)
        for part in (
            cell,
            *(output for output in cell.outputs if "execution_count" in output),
        ):
            part.execution_count = number


def code_lines(name: str) -> int:
    """Lines of code of a notebook, without empty ones."""
    import jupytext

    cells = jupytext.read(FOLDER / f"{name}.py").cells
    return sum(
        bool(line.strip())
        for cell in cells
        if cell.cell_type == "code"
        for line in cell.source.splitlines()
    )


def _page(name: str, notebook: Any) -> tuple[str, dict[str, bytes]]:
    """The Markdown of a notebook and its pictures."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            data = output.get("data", {})
            if "image/png" in data:
                place = f"{name}_{len(pictures)}.png"
                pictures[place] = base64.b64decode(data["image/png"])
                parts.append(f"![output]({place})")
            elif "text/html" in data:
                parts.append(_html("".join(data["text/html"])))
            else:
                text = output.get("text") or data.get("text/plain", "")
                parts.append("```text\n" + "".join(text).rstrip() + "\n```")
    return "\n\n".join([*parts, HEAD.format(name=name)]) + "\n", pictures


def _html(text: str) -> str:
    """The HTML of an output, which Markdown takes as it is: without styles and empty lines."""
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    lines = [
        line
        for line in text.replace('border="1" class="dataframe"', "").splitlines()
        if line.strip()
    ]
    return '<div class="output">\n' + "\n".join(lines) + "\n</div>"
