"""The tracks of a tracker with the futures of their objects, from which a predictor learns."""

import mtp_bench

windows = mtp_bench.windows(
    "MTP-Roundabout-v0", "train", tracker=5, scenes=2
)  # five hypotheses
real = windows.select((windows.object_id >= 0) & windows.future_known.all(axis=1))
learn, held_out = real.split((1, 2))  # whole scenes are held out
print(f"{len(windows)} windows, {len(real)} with a whole future")
print("box", real.box.shape, "future", real.future.shape)
