"""Make the study that docs/visualization/study.md shows: its page, two figures and what the command prints.

python -m docs.generate.studies
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from mtp_bench.core.files import write_text

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "docs" / "visualization" / "study.md"
PAGES = ROOT / "docs" / "visualization" / "studies"
PICTURES = ROOT / "docs" / "pictures"
ENV = "MTP-Intersection-v0"
COMMAND = ("study", "--env", ENV, "--quick", "-o", "study")
FIGURES = ("parts", "hypotheses")
OUTPUT = re.compile(r"(?<=```text\n).*?(?=```)", re.DOTALL)  # one block of the guide


def main() -> None:
    """Run the command in an empty folder, and put its results on the site."""
    run_path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "mtp_bench", *COMMAND],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": run_path, "MTP_BENCH_QUIET": "1"},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        study = Path(folder) / "study"
        shutil.copyfile(study / "index.html", PAGES / f"{ENV}.html")
        for name in FIGURES:
            picture = PICTURES / f"study_{name}.png"
            shutil.copyfile(study / "figures" / f"{name}.png", picture)
    guide = GUIDE.read_text(encoding="utf-8")
    write_text(GUIDE, OUTPUT.sub(lambda _: done.stdout, guide))


if __name__ == "__main__":
    main()
