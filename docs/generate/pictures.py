"""Draw one frame of every simulated environment, with what STP says of it.

    python -m docs.generate.pictures

Recorded scenes are not drawn: nothing of a dataset is published.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
from PIL import Image

import mtp_bench

FOLDER = Path(__file__).resolve().parents[1] / "environment" / "pictures"
SECONDS = 8.0  # into the scene
WIDTH = 800  # px
LARGEST = 80_000  # bytes of a picture


def main() -> None:
    """Draw all of them."""
    for env_id in mtp_bench.card_ids():
        if mtp_bench.load_card(env_id).source.name == "highway":
            draw(env_id)


def draw(env_id: str) -> None:
    """Draw an environment: its first scene."""
    env = gym.make(env_id, render_mode="rgb_array", disable_env_checker=True)
    world = env.unwrapped
    assert isinstance(world, mtp_bench.MTPEnv)
    agent = mtp_bench.load_submission("stp").build(world.task)
    agent.reset(world.task)
    observation, _ = env.reset(seed=0, options={"scene": world.scene_names[0]})
    for _ in range(round(SECONDS * world.card.task.rate) + 1):
        observation, *_ = env.step(agent.act(observation))
    image = Image.fromarray(env.render())  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
    image = image.resize((WIDTH, round(WIDTH * image.height / image.width)), Image.Resampling.LANCZOS)
    path = FOLDER / f"{env_id}.webp"
    image.save(path, quality=80, method=6)
    if path.stat().st_size > LARGEST:
        raise SystemExit(f"{path.name} has {path.stat().st_size} bytes, expected at most {LARGEST}")
    env.close()


if __name__ == "__main__":
    main()
