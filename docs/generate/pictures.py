"""Draw one frame of every simulated environment, with what STP says of it.

    python -m docs.generate.pictures

Recorded scenes are not among them: nothing of a dataset is published (`recordings.py`).
"""

from __future__ import annotations

import io
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
        if mtp_bench.load_card(env_id).simulated:
            content = picture_of(env_id)
            if len(content) > LARGEST:
                raise SystemExit(f"{env_id}.webp has {len(content)} bytes, expected at most {LARGEST}")
            (FOLDER / f"{env_id}.webp").write_bytes(content)


def picture_of(env_id: str) -> bytes:
    """The first scene of an environment, as WebP. Raises MtpBenchError where its data is missing."""
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
    env.close()
    content = io.BytesIO()
    image.save(content, format="webp", quality=80, method=6)
    return content.getvalue()


if __name__ == "__main__":
    main()
