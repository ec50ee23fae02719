"""Makes the pictures of `docs/visualization/why.md` (the costliest event of a kind) and `docs/environment/driving.md`.

    python docs/make_pictures.py               # simulated traffic, into docs/pictures
    python docs/make_pictures.py --real FOLDER # recordings under MTP_BENCH_DATA, into FOLDER

Pictures of recordings are not committed: their licences do not allow it. `make docs DATA=folder` draws them into your
copy of the site.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image

import mtp_bench
from mtp_bench.running.stored import open_run
from mtp_bench.viz.causes import sentence
from mtp_bench.viz.drawing.birds_eye import draw_frame
from mtp_bench.viz.drawing.report import save_report
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.framing import Window
from mtp_bench.viz.played import PlayedRun
from mtp_bench.viz.terminal.event_table import Listed, in_order

HERE = Path(__file__).parent / "pictures"


class Shot(NamedTuple):
    """The costliest event of a kind in a scene; the first scene where none is named."""

    env_id: str
    kind: str
    scene: str | None = None


SIMULATED = {
    "focus_ids": Shot("MTP-Intersection-v0", "ids"),
    "focus_lost": Shot("MTP-Merge-v0", "lost"),
    "focus_reacquired": Shot("MTP-Roundabout-v0", "reacquired"),
}
REAL = {
    "focus_nuscenes_ids": Shot("MTP-nuScenes-mini-v0", "ids", "scene-0655"),
    "focus_kitti_lost": Shot("MTP-KITTI-v0", "lost", "0016"),
    "focus_pets_ids": Shot("MTP-PETS-v0", "ids", "PETS09-S2L1-0701"),
}


TURN = (
    "MTP-Drive-Intersection-v0",
    "intersection-010001",
)  # of `docs/environment/driving.md`
SHOWN, AROUND = range(22), 50.0  # frames, and m that are shown around the ego


def drive(path: Path) -> None:
    """Let the plain baseline drive the left turn, as WebP at twice the real speed."""
    env_id, scene = TURN
    with tempfile.TemporaryDirectory() as folder:
        mtp_bench.run("stp", env_id, folder, scenes=[scene])
        opened = open_run(Path(folder))
        run = PlayedRun(opened).replay(opened.first(), opened.drawn(scene))
    windows = [Window(x, y, AROUND, AROUND) for x, y in run.scene.ego[:, :2].tolist()]
    images = [
        Image.fromarray(draw_frame(run, t, windows[t])).resize((720, 540))
        for t in SHOWN
    ]
    images[0].save(
        path,
        save_all=True,
        append_images=images[1:],
        duration=250,
        loop=0,
        quality=30,
        method=4,
    )


def take(shot: Shot, path: Path) -> str:
    """Run the plain baseline on the scene and draw its costliest event of this kind; the sentence about it."""
    with tempfile.TemporaryDirectory() as folder:
        mtp_bench.run(
            "stp", shot.env_id, folder, scenes=1 if shot.scene is None else [shot.scene]
        )
        opened = open_run(Path(folder))
        run = PlayedRun(opened).replay(
            opened.first(), opened.drawn(opened.first().scene)
        )
    events = [
        Listed.of(run, each, "run", None)
        for each in run.incidents
        if each.kind == shot.kind
    ]
    focus = Focus(run, in_order(events, "cost")[0].incident)
    save_report(path, focus)
    return sentence(focus)


def main() -> None:
    """Make all pictures of one of the two sets."""
    parser = argparse.ArgumentParser(description="pictures of the pages")
    parser.add_argument(
        "--real",
        type=Path,
        metavar="FOLDER",
        help="pictures of recordings, into this folder",
    )
    folder = parser.parse_args().real
    for name, shot in (SIMULATED if folder is None else REAL).items():
        target = HERE if folder is None else folder
        target.mkdir(parents=True, exist_ok=True)
        print(f"{target / name}.png: {take(shot, target / f'{name}.png')}")
    if folder is None:
        drive(HERE / "driving.webp")


if __name__ == "__main__":
    main()
