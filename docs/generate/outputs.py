"""Run examples and write what they print, for the pages that show it.

    python -m docs.generate.outputs        # all that are shown; docs/outputs/NAME.txt

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
COLUMNS = "110"


def run(example: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run an example in an empty ``folder``."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "COLUMNS": COLUMNS, "NO_COLOR": "1", "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(example), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def main() -> None:
    """Write the output of every example that has one already, or of those that are named."""
    names = sys.argv[1:] or [path.stem for path in sorted(OUTPUTS.glob("*.txt"))]
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            done = run(ROOT / "examples" / f"{name}.py", Path(folder))
        if done.returncode:
            raise SystemExit(done.stderr)
        (OUTPUTS / f"{name}.txt").write_text("\n".join(line.rstrip() for line in done.stdout.splitlines()) + "\n")


if __name__ == "__main__":
    main()
