"""CPU and memory of `mtp-bench board` against the number of records: those that ship, and copies of them.

    python benchmarks/board.py [--times 1,3,10] [--env MTP-KITTI-v0]

Every copy has another name, errors that differ by 2 % per unit, and its own signature. Each row runs the command twice,
with one thread: signatures are checked in the first run and kept in a cache folder of its own. "to n log n" is the
growth of the second run over that of n log(n + 1), from the first row on: 1 or less where it grows no faster.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from mtp_bench.core.bundle import bundled
from mtp_bench.judge import Record, load_record, record_paths
from mtp_bench.judge.records.attestation import Statement, write_level
from mtp_bench.judge.records.storage import record_text

SIGNER = "benchmark"
NOISE = 0.02  # of the error of a unit, relative


def main() -> None:
    from rich.console import Console
    from rich.table import Table

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--times", default="1,3,10", help="records as a multiple of those that ship"
    )
    parser.add_argument("--env", help="only this environment")
    given = parser.parse_args()
    table = Table(title=f"mtp-bench board{f' --env {given.env}' if given.env else ''}")
    for column in (
        "records",
        "first run, CPU s",
        "again, CPU s",
        "ms per record",
        "to n log n",
        "peak MiB",
    ):
        table.add_column(column, justify="right")
    begin: tuple[int, float] | None = None
    for times in map(int, given.times.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            records = leaderboard(Path(folder), times, given.env)
            (first, _), (again, peak) = (
                spent(Path(folder), given.env) for _ in range(2)
            )
        begin = begin or (records, again)
        growth = (
            again
            / begin[1]
            / (records * math.log1p(records) / (begin[0] * math.log1p(begin[0])))
        )
        numbers = (first, again, 1000 * again / records, growth, peak)
        table.add_row(
            str(records),
            *(
                f"{x:{f}}"
                for x, f in zip(
                    numbers, (".1f", ".1f", ".1f", ".2f", ".0f"), strict=True
                )
            ),
        )
    Console().print(table)


def leaderboard(folder: Path, times: int, env: str | None) -> int:
    """Make a leaderboard with ``times`` copies of each record that ships; their number."""
    ships, key = bundled("leaderboard"), folder / "key"
    made = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", SIGNER, "-f", str(key)]
    subprocess.run(made, check=True, capture_output=True)
    for name in ("seals", "targets"):
        shutil.copytree(ships / name, folder / name)
    (folder / "keys").mkdir()
    kind, public, *_ = key.with_name("key.pub").read_text().split()
    (folder / "keys" / "allowed_signers").write_text(f"{SIGNER} {kind} {public}\n")
    paths = record_paths(ships / "records", env or "")
    if not paths:
        raise SystemExit(
            f"no record of {env} ships; expected an environment with records, see `mtp-bench board`"
        )
    for path in paths:
        record = load_record(path)
        level = json.loads(path.read_text()).get("level")
        signed = (
            None
            if level is None
            else Statement.model_validate_json(json.dumps(level["statement"]))
        )
        for number in range(times):
            copied = copy(record, number)
            file = folder / "records" / copied.submission.name / path.name
            file.parent.mkdir(parents=True, exist_ok=True)
            copied, text = record_text(copied, file)
            file.write_text(text)
            if signed is not None:
                of = {"record": copied.digest, "measured": copied.measured.digest}
                write_level(file, signed.model_copy(update=of), key, SIGNER)
    return times * len(paths)


def copy(record: Record, number: int) -> Record:
    """The record itself, or a copy under another name with errors a little off."""
    if not number:
        return record
    rng = np.random.default_rng([number, *record.submission.name.encode()])
    name = f"{record.submission.name}-{number}"

    factors = np.exp(NOISE * rng.normal(size=record.targets.units))
    errors = {
        subset: (np.array(sums) * factors).tolist()
        for subset, sums in record.error.items()
    }
    submission = record.submission.model_copy(update={"name": name})
    return record.model_copy(update={"submission": submission, "error": errors})


def spent(folder: Path, env: str | None) -> tuple[float, float]:
    """CPU seconds and peak memory [MiB] of the command on the records of a leaderboard."""
    words = [
        "board",
        "--records",
        str(folder / "records"),
        "--base",
        str(folder),
        *(["--env", env] if env else []),
    ]
    environment = {
        **os.environ,
        "MTP_BENCH_CACHE": str(folder / "cache"),
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "mtp_bench", *words]
    child = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise SystemExit(f"mtp-bench {' '.join(words)} failed")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


if __name__ == "__main__":
    main()
