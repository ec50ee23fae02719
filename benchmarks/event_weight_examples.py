"""Draw two identity switches of STP: one that nearly all runs of the reference have, and one that few have.

    python benchmarks/event_weight_examples.py [-o envs/reference/examples.svg]

Both are of MTP-Intersection-v0, three frames each: true boxes grey, detections crosses, tracks outlined and numbered.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mtp_bench import MTPEnv
from mtp_bench.agent import load_submission
from mtp_bench.cards import load_card
from mtp_bench.core import Floats, Ragged, Rollout, Scene
from mtp_bench.running.playing import run_scene
from mtp_bench.running.reference import frozen_reference
from mtp_bench.scoring.targets import find_targets

ENV = "MTP-Intersection-v0"
EXAMPLES = (
    ("intersection-010042", 14, 40),
    ("intersection-010044", 12, 2),
)  # scene, frame, object
COLORS = ("#0072b2", "#d55e00")  # the track that was the object's, and the one that is
OTHER = "#777777"  # tracks
WIDTH, HEIGHT, HEAD = 300, 150, 46  # px
SCALE = {"pedestrian": 60.0, "car": 18.0}  # px per m


@dataclass(frozen=True)
class Panel:
    """One frame around the object; ``left`` and ``top`` in pixels of the drawing."""

    scene: Scene
    rollout: Rollout
    t: int
    center: Floats
    left: float
    top: float
    scale: float

    def place(self, xy: Floats) -> Floats:
        """Metres to pixels, y up."""
        middle = np.array([self.left + WIDTH / 2, self.top + HEIGHT / 2])
        return np.asarray(
            middle + (xy - self.center) * np.array([self.scale, -self.scale])
        )

    def near(self, table: Ragged, box: Floats) -> list[int]:
        """Rows of this frame inside the panel."""
        reach = np.array([WIDTH, HEIGHT]) / 2 / self.scale
        rows = table.rows(self.t)
        inside = (np.abs(box[rows, :2] - self.center) < reach - 0.2).all(axis=1)
        return [rows.start + int(row) for row in np.flatnonzero(inside)]

    def outline(self, box: Floats, style: str) -> str:
        """A box from above."""
        x, y, _, yaw, length, width, _ = (float(value) for value in box)
        corners = (
            np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
            * np.array([length, width])
            / 2
        )
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        points = " ".join(
            f"{px:.1f},{py:.1f}"
            for px, py in self.place(np.array([x, y]) + corners @ turn)
        )
        return f'<polygon points="{points}" {style}/>'

    def draw(self, title: str, colors: Mapping[int, str]) -> list[str]:
        """The lines of the SVG."""
        truth, seen, said = self.scene.truth, self.scene.detections, self.rollout
        frame = f'x="{self.left}" y="{self.top}" width="{WIDTH}" height="{HEIGHT}"'
        lines = [f'<rect {frame} fill="white" stroke="#bbb"/>']
        lines += [
            self.outline(truth.box[i], 'fill="#ddd" stroke="none"')
            for i in self.near(truth, truth.box)
        ]
        for row, i in enumerate(self.near(said.tracks, said.track_box)):
            color, number = (
                colors.get(int(said.track_id[i]), OTHER),
                int(said.track_id[i]),
            )
            lines.append(
                self.outline(
                    said.track_box[i], f'fill="none" stroke="{color}" stroke-width="2"'
                )
            )
            at = f'x="{self.left + WIDTH - 8}" y="{self.top + HEIGHT - 10 - 17 * row}" text-anchor="end"'
            lines.append(f'<text {at} fill="{color}">track {number}</text>')
        for i in self.near(seen, seen.box):
            x, y = self.place(seen.box[i, :2])
            lines.append(
                f'<path d="M{x - 5:.1f} {y - 5:.1f}l10 10m0 -10l-10 10" stroke="black" stroke-width="1.5"/>'
            )
        return [*lines, f'<text x="{self.left + 8}" y="{self.top + 18}">{title}</text>']


def example(scene_name: str, t: int, object_id: int, top: float) -> list[str]:
    """One row of panels with its headline."""
    card = load_card(ENV)
    reference, submission = frozen_reference(card), load_submission("stp")
    assert reference is not None
    env = MTPEnv(card, evaluation=True)
    rollout = run_scene(submission.build(env.task), env, scene_name, 0)
    scene, targets = env.scene, find_targets(env.scene, card)
    place = int(
        np.flatnonzero((targets.frame == t) & (targets.object_id == object_id))[0]
    )
    center, name = (
        scene.truth.box[targets.row[place], :2],
        card.task.classes[targets.class_id[place]],
    )
    known = reference.of(scene_name)
    assert known.stp[place, 0], "STP itself switches here"
    old, new = (nearest_track(scene, rollout, when, object_id) for when in (t - 1, t))
    share = f"{int(known.counts[place, 0])} of {reference.runs} runs"
    text = f"A {name} changes from track {old} to track {new}: {share} do so, its weight in ids is"
    lines = [
        f'<text x="10" y="{top + 30}" font-weight="bold">{text} {known.counts[place, 0] / reference.runs:.2f}</text>'
    ]
    colors = dict(zip((old, new), COLORS, strict=True))
    for column, step in enumerate((-1, 0, 1)):
        left, title = (
            10 + column * (WIDTH + 10),
            f"frame t{step:+d}" if step else "frame t",
        )
        lines += Panel(
            scene, rollout, t + step, center, left, top + HEAD, SCALE[name]
        ).draw(title, colors)
    return lines


def nearest_track(scene: Scene, rollout: Rollout, t: int, object_id: int) -> int:
    """Id of the track nearest to the object."""
    rows, said = scene.truth.rows(t), rollout.tracks.rows(t)
    true = scene.truth.box[rows][scene.truth.object_id[rows] == object_id][0, :2]
    return int(
        rollout.track_id[said][
            np.argmin(np.hypot(*(rollout.track_box[said, :2] - true).T))
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("envs/reference/examples.svg")
    )
    output = parser.parse_args().output
    row, width = HEAD + HEIGHT + 10, 20 + 3 * WIDTH + 20
    height = row * len(EXAMPLES) + 10
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    lines = [
        f'{head} font-family="sans-serif" font-size="14">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for number, (scene_name, t, object_id) in enumerate(EXAMPLES):
        lines += example(scene_name, t, object_id, number * row)
    output.write_text("\n".join([*lines, "</svg>"]) + "\n")


if __name__ == "__main__":
    main()
