# %% [markdown]
# # Your own torch model
#
# This notebook trains a network on tracks, puts it into an agent, scores it, and ends with a table for a paper. Two
# training scenes of simulated traffic take seconds; for a real result take more of them.

# %%
import torch

import mtp_bench
from mtp_bench.prediction import GreedySampler, LearnedPresence, local_future, local_inputs, to_absolute, windows_of
from mtp_bench.tracking import HypothesisTracker

torch.manual_seed(0)
windows = mtp_bench.windows("MTP-Intersection-v0", "train", tracker=5, scenes=2)  # of a tracker with five hypotheses
windows = windows.select((windows.object_id >= 0) & windows.future_known.all(axis=1))
task = windows.task
windows

# %% [markdown]
# The network gets the past of a track in the heading frame of its last box and gives k futures. Of these, only the
# best one learns.

# %%
sizes = 2 * task.past, 64, task.k * task.future * 2
model = torch.nn.Sequential(torch.nn.Linear(*sizes[:2]), torch.nn.ReLU(), torch.nn.Linear(*sizes[1:]))


def inputs(windows):  # [n, 2 P]
    seen = local_inputs(windows)
    return torch.from_numpy(seen["position"] * seen["alive"][:, :, None]).flatten(1)


def futures(past):  # [n, k, T, 2] metres, in the heading frame
    return model(past).unflatten(1, (task.k, task.future, 2))


past, true = inputs(windows), torch.from_numpy(local_future(windows, windows.future))
optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3)
for _epoch in range(10):
    for rows in torch.randperm(len(past)).split(256):
        distance = (futures(past[rows]) - true[rows, None]).norm(dim=-1).mean(-1)
        optimizer.zero_grad()
        distance.min(dim=1).values.mean().backward()
        optimizer.step()

# %% [markdown]
# A predictor is asked once per frame, for the tracks of all hypotheses.


# %%
class Mine:
    def reset(self, task):
        """Begin a new scene."""

    def predict(self, frame):
        windows, row = windows_of(frame, task.past)
        with torch.no_grad():
            return mtp_bench.Forecasts(to_absolute(windows, futures(inputs(windows)).numpy()), row=row)


def my_model(task):
    return mtp_bench.Pipeline(HypothesisTracker(5), Mine(), GreedySampler(), presence=LearnedPresence())


report = mtp_bench.evaluate(my_model, "MTP-Intersection-v0", scenes=2)
report

# %% [markdown]
# All numbers are a DataFrame: a row for each agent and subset of the targets. pandas writes the table in LaTeX.

# %%
frame = report.to_frame().set_index("subset")[["error", "minADE", "minFDE", "targets"]]
frame

# %%
print(frame.to_latex(float_format="%.2f"))
