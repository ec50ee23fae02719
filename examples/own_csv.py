"""A log of two cars in CSV: tables, env, STP, score, picture. Tables and columns: docs/data/own.md."""

from pathlib import Path

from PIL import Image

import mtp_bench

Path("logs/one").mkdir(parents=True)
for table, ids in (("truth", ("0,", "1,")), ("detections", ("", ""))):
    rows = [f"{t},{i}car,{2 * t + 3 * n},{4 * n},0,4.5,1.8,1.6\n" for t in range(30) for n, i in enumerate(ids)]
    Path(f"logs/one/{table}.csv").write_text(f"frame,{'id,' if ids[0] else ''}class,x,y,yaw,l,w,h\n" + "".join(rows))
env = mtp_bench.MTPEnv("MTP-nuScenes-v0", files="logs", render_mode="rgb_array")
mtp_bench.run("stp", env.card, "runs/stp")
print(mtp_bench.score("runs/stp").report.rows[0])
agent, (observation, _) = mtp_bench.load_submission("stp").build(env.task), env.reset(seed=0)
agent.reset(env.task)
for _ in range(20):
    observation, *_ = env.step(agent.act(observation))
Image.fromarray(env.render()).save("own.png")
