"""Run examples and write what they print, for the pages that show it.

    python -m docs.generate.outputs                 # all that are shown; docs/outputs/NAME.txt
    python -m docs.generate.outputs own_predictor reference/agents

`tests/test_examples.py` compares what an example prints now with what is shown.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OUTPUTS = ROOT / "docs" / "outputs"
EXAMPLES = ROOT / "examples"
COLUMNS = "110"


def run(
    example: Path, folder: Path, *arguments: str
) -> subprocess.CompletedProcess[str]:
    """Run an example in an empty ``folder``."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {
        **os.environ,
        "COLUMNS": COLUMNS,
        "NO_COLOR": "1",
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, str(example), *arguments]
    return subprocess.run(
        command,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def main() -> None:
    """Write the output of every example that has one already, or of those that are named."""
    shown = [
        path.relative_to(OUTPUTS).with_suffix("")
        for path in sorted(OUTPUTS.rglob("*.txt"))
    ]
    for name in sys.argv[1:] or shown:
        with tempfile.TemporaryDirectory() as folder:
            done = run(EXAMPLES / f"{name}.py", Path(folder))
        if done.returncode:
            raise SystemExit(done.stderr)
        (OUTPUTS / f"{name}.txt").write_text(
            "\n".join(line.rstrip() for line in done.stdout.splitlines()) + "\n"
        )


if __name__ == "__main__":
    main()
