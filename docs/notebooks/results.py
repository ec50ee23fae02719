# %% [markdown]
# # Results in pandas, and a plot
#
# This notebook compares agents, reads the report with pandas, and draws where the error comes from. `compare` adds
# the controls to those that you name.

# %%
import matplotlib.pyplot as plt
import pandas as pd

import mtp_bench

comparison = mtp_bench.compare(["stp"], "MTP-Intersection-v0", scenes=2)
comparison

# %% [markdown]
# `to_frame` has a row for each agent, setting and subset of the targets. `samples` is the number of samples per
# object; agents are compared where it is the k of the task, `budget == "equal"`.

# %%
frame = comparison.report.to_frame()
frame = frame[frame.budget == "equal"]
frame.pivot_table("error", "agent", "subset")[["all", "ids"]].sort_values("all").round(2)

# %% [markdown]
# bADE over all targets is the sum of two parts: of targets with a forecast, and of those without one.

# %%
parts = frame[frame.subset == "all"].sort_values("error").set_index("agent")[["localisation", "missed"]]
axes = parts.plot.barh(stacked=True, figsize=(8, 4), color=["#0072b2", "#d55e00"])
axes.set(xlabel="bADE, m", ylabel="")
axes.legend(["with a forecast", "without a forecast"])
plt.tight_layout()
plt.show()

# %% [markdown]
# `per_scene` has the numbers of single scenes, here minADE of every agent in every scene.

# %%
scenes = pd.DataFrame(comparison.report.per_scene())
scenes.pivot_table("minADE", "agent", "scene").round(2)
