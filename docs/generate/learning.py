"""Draw the learning curves of `examples/rl_association.py`.

    python -m docs.generate.learning        # docs/environment/association.svg

The numbers are those that the example prints; a run of it takes minutes.
"""

from __future__ import annotations

from pathlib import Path

from .svg import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, Point, drawing, line, text

FILE = Path(__file__).resolve().parents[1] / "environment" / "association.svg"
EVERY = 2048  # steps between two numbers, the first of them after as many
CURVES = {  # metres per frame against "nearest"
    "PPO, seed 0": (6.21, 7.81, 8.38, 8.48, 9.26, 9.02, 9.49, 8.72),
    "PPO, seed 1": (5.60, 6.30, 6.38, 6.23, 6.87, 5.18, 6.13, 7.57),
    "PPO, seed 2": (-21.08, -9.47, 2.51, 5.06, 4.53, 5.96, 5.85, 7.36),
    "DQN, seed 0": (3.97, 5.31, 5.82, 5.91, 4.34, 5.05, 2.39, 6.71),
}
LEFT, ZERO, WIDTH, METRE = (
    60.0,
    110.0,
    480.0,
    7.5,
)  # px: left end, height of gain 0, width, and of a metre


def curves() -> str:
    """The gain of each run over the steps of training."""
    rows = [
        text((LEFT, 18), "metres per frame better than nearest, on five other scenes")
    ]
    for gain in (-20, -10, 10):
        rows += [
            line([_at(0, gain), _at(8, gain)], "#dddddd", 1),
            text(_moved(_at(0, gain), -8, 5), f"{gain:+}", GREY, "end"),
        ]
    rows += [
        line([_at(0, 0), _at(8, 0)], BLACK),
        text(_moved(_at(8, 0), 8, 5), "nearest"),
    ]
    for step in (2, 4, 6, 8):
        rows.append(
            text(
                _moved(_at(step, -22), 0, 20),
                f"{step * EVERY:,}".replace(",", " "),
                GREY,
                "middle",
            )
        )
    rows.append(
        text(
            _moved(_at(4, -22), 0, 42),
            "steps of training, one detection each",
            GREY,
            "middle",
        )
    )
    for i, ((name, gains), color) in enumerate(
        zip(CURVES.items(), (BLUE, PURPLE, GREEN, ORANGE), strict=True)
    ):
        rows += [line([_at(k, gain) for k, gain in enumerate(gains, start=1)], color)]
        rows += [
            text((LEFT + WIDTH + 8, 24 + 18 * i), f"{name}: {gains[-1]:+.1f}", color)
        ]
    return drawing(700, 330, rows)


def _at(number: float, gain: float) -> Point:
    """The point of a gain after ``number`` parts of the training."""
    return LEFT + WIDTH * number / 8, ZERO - METRE * gain


def _moved(at: Point, right: float, down: float) -> Point:
    return at[0] + right, at[1] + down


if __name__ == "__main__":
    FILE.write_text(curves())
