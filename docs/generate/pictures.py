"""Moving pictures of environments, as `render()` draws them, with what STP says of the scene.

They are drawn while the site is built. Without the data (`recordings.py`) a drawing stands in for recordings.
"""

from __future__ import annotations

import io

import gymnasium as gym
from PIL import Image

import mtp_bench

from .svg import BLACK, GREY, LIGHT, box, drawing, text

FROM = 4.0  # seconds into the scene
FRAMES, SHOWN_RATE = 12, 5  # frames, and how many of them are shown per second
SIZE = 600, 450  # px
QUALITY, EFFORT = 50, 2  # of WebP: more effort makes files hardly smaller


def stride(rate: float) -> int:
    """Frames of the scene from one picture to the next: about five a second where there are that many."""
    return max(1, round(rate / SHOWN_RATE))


def speed(rate: float) -> float:
    """Factor by which the picture moves faster than the world."""
    return SHOWN_RATE * stride(rate) / rate


def moving_picture(env_id: str) -> bytes:
    """The first scene of an environment, as WebP. Raises MtpBenchError where its data is missing."""
    env = gym.make(env_id, render_mode="rgb_array", disable_env_checker=True)
    world = env.unwrapped
    assert isinstance(world, mtp_bench.MTPEnv)
    agent = mtp_bench.load_submission("stp").build(world.task)
    agent.reset(world.task)
    observation, _ = env.reset(seed=0, options={"scene": world.scene_names[0]})
    rate = world.card.task.rate
    first, step, over, frame = round(FROM * rate), stride(rate), False, 0
    images: list[Image.Image] = []
    while not over and len(images) < FRAMES:
        observation, _, over, *_ = env.step(agent.act(observation))
        if not over and frame >= first and (frame - first) % step == 0:
            drawn = Image.fromarray(env.render())  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
            images.append(drawn.resize(SIZE, Image.Resampling.BILINEAR))
        frame += 1
    env.close()
    content = io.BytesIO()
    moving = {
        "save_all": True,
        "append_images": images[1:],
        "duration": 1000 // SHOWN_RATE,
        "loop": 0,
    }
    images[0].save(content, "webp", quality=QUALITY, method=EFFORT, **moving)
    return content.getvalue()


def placeholder(env_id: str, dataset: str) -> str:
    """A drawing in place of the picture of recordings that are not here."""
    words = {
        150: env_id,
        215: f"Recordings of {dataset}",
        245: "are not ours to publish.",
        300: "make docs DATA=folder",
    }
    middle = SIZE[0] / 2
    lines = [box((middle, SIZE[1] / 2), (SIZE[0] - 4, SIZE[1] - 4), LIGHT, GREY)]
    lines += [
        text((middle, y), line, BLACK, "middle", bold=y in (150, 300))
        for y, line in words.items()
    ]
    lines.append(text((middle, 330), "draws a picture here.", BLACK, "middle"))
    return drawing(*SIZE, lines).replace('font-size="14"', 'font-size="22"')
