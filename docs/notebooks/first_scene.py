# %% [markdown]
# # A first scene and its detections
#
# This notebook shows what an environment gives to an agent, and what it keeps from it. The traffic is simulated: no
# data is downloaded.

# %%
import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import mtp_bench

env = gym.make("MTP-Intersection-v0", render_mode="rgb_array")
observation, info = env.reset(seed=0)
for name, value in observation.items():
    print(f"{name:18} {value.shape}")

# %% [markdown]
# All arrays are padded; `detection_valid` marks the rows that hold a detection. `task` has the rules of the
# environment.

# %%
task = env.unwrapped.task
seen = observation["detection_valid"] == 1
print(f"{seen.sum()} detections in the first frame; classes: {', '.join(task.classes)}")
print(f"forecast {task.future} frames of {task.dt} s, with k = {task.k} samples for each object")

# %% [markdown]
# An agent answers every frame with an action. This one forecasts no object, so every target costs its miss error.
# `terminated` is true after the last frame.

# %%
no_object = mtp_bench.make_action(task, np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros((0, task.future, 2)))
places, total, terminated = [], 0.0, False
while not terminated:
    seen = observation["detection_valid"] == 1
    places.append(observation["detection_box"][seen, :2])
    observation, reward, terminated, _, info = env.step(no_object)
    total += reward
    if len(places) == 16:
        picture = env.render()
print(f"{len(places)} frames, {sum(map(len, places))} detections, reward {total:.0f} m")

# %% [markdown]
# The environment draws itself from above, with the truth that the agent does not see.

# %%
plt.figure(figsize=(8, 6))
plt.imshow(picture)
plt.axis("off")
plt.show()

# %% [markdown]
# Detections have no identities: the tracker has to find out which of these points belong together. Dark points are
# early, bright ones late.

# %%
seconds = np.repeat(np.arange(len(places)) * task.dt, [len(place) for place in places])
x, y = np.concatenate(places).T
plt.figure(figsize=(6, 5))
plt.scatter(x, y, c=seconds, s=6)
plt.colorbar(label="s")
plt.gca().set(xlabel="x, m", ylabel="y, m", aspect="equal")
plt.show()
