"""Draw the learning curves of `examples/rl_association.py`.

    python -m docs.generate.learning        # docs/environment/association.svg

The numbers are those that the example prints; a run of it takes minutes.
"""

from __future__ import annotations

from pathlib import Path

from .svg import BLACK, BLUE, GREY, ORANGE, Point, drawing, line, text

FILE = Path(__file__).resolve().parents[1] / "environment" / "association.svg"
EVERY = 2048  # steps between two numbers, the first of them after as many
CURVES = {  # metres per frame against "nearest"
    "PPO, seed 0": (6.21, 7.81, 8.38, 8.48, 9.26, 9.02, 9.49, 8.72),
    "PPO, seed 1": (5.60, 6.30, 6.38, 6.23, 6.87, 5.18, 6.13, 7.57),
    "DQN, seed 0": (3.97, 5.31, 5.82, 5.91, 4.34, 5.05, 2.39, 6.71),
}
LEFT, BOTTOM, WIDTH, HEIGHT, MOST = 60.0, 230.0, 480.0, 200.0, 10.0


def curves() -> str:
    """The gain of each run over the steps of training."""
    rows = [line([_at(0, 0), _at(8, 0)], BLACK), text((LEFT + WIDTH + 8, BOTTOM + 5), "nearest")]
    for gain in (2, 4, 6, 8, 10):
        rows += [
            line([_at(0, gain), _at(8, gain)], "#dddddd", 1),
            text(_shifted(_at(0, gain), -8, 5), f"+{gain}", GREY, "end"),
        ]
    for step in (2, 4, 6, 8):
        rows.append(text(_shifted(_at(step, 0), 0, 20), f"{step * EVERY:,}".replace(",", " "), GREY, "middle"))
    for (name, gains), color in zip(CURVES.items(), (BLUE, "#56b4e9", ORANGE), strict=True):
        points = [_at(i, gain) for i, gain in enumerate(gains, start=1)]
        rows += [line(points, color), text(_shifted(points[-1], 8, 5), name, color)]
    rows += [
        text((LEFT, 18), "metres per frame better than nearest, on five other scenes"),
        text(_shifted(_at(4, 0), 0, 42), "steps of training, one detection each", GREY, "middle"),
    ]
    return drawing(660, 285, rows)


def _at(number: float, gain: float) -> Point:
    """The point of a gain after ``number`` parts of the training."""
    return LEFT + WIDTH * number / 8, BOTTOM - HEIGHT * gain / MOST


def _shifted(at: Point, right: float, down: float) -> Point:
    return at[0] + right, at[1] + down


if __name__ == "__main__":
    FILE.write_text(curves())
