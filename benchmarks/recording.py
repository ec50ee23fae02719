"""Recordings: seconds and megabytes per scene with the heaviest and with all hypotheses, for runs written by `mtp-bench run`.

``python benchmarks/recording.py FOLDER...``: importing rerun, reading the run and comparing it with the truth are not
counted. Each recording is written three times; the least of the seconds is shown.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from mtp_bench.running.stored import open_run
from mtp_bench.viz.rerun.recording import save_recording
from mtp_bench.viz.run_replay import Replay, replay


def main(folders: list[str]) -> None:
    print(
        f"{'run':12} {'scene':22} {'H':>3} {'frames':>6} {'all':>7} {'CPU s':>7} {'s':>7} {'MB':>6}"
    )
    for folder in folders:
        opened = open_run(Path(folder))
        for rollout in opened.run.rollouts:
            run = replay(
                opened.scene(rollout.scene), rollout, opened.card, opened.run.info.agent
            )
            for is_all in (False, True):
                processor, wall, size = measure(run, is_all)
                which = f"{run.agent:12} {rollout.scene:22} {rollout.member.shape[1]:3} {rollout.frames:6} {is_all!s:>7}"
                print(f"{which} {processor:7.3f} {wall:7.3f} {size / 1e6:6.2f}")


def measure(run: Replay, is_all: bool) -> tuple[float, float, int]:
    """Seconds of the processor, seconds and bytes of one recording."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.rrd"
        seconds = []
        for _ in range(3):
            start = time.process_time(), time.perf_counter()
            save_recording(path, [run], is_all)
            seconds.append(
                (time.process_time() - start[0], time.perf_counter() - start[1])
            )
        return (
            min(s[0] for s in seconds),
            min(s[1] for s in seconds),
            path.stat().st_size,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
