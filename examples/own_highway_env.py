"""An own environment of highway-env with simulated detections and lanes: recorded, tracked, predicted and scored.

    python examples/own_highway_env.py

Keys of the source: docs/data/highway_env.md.
"""

# --8<-- [start:environment]
import gymnasium
import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

import mtp_bench
from mtp_bench.cards import load_card, parse_card


class BendEnv(AbstractEnv):
    """Cars and trucks on a road of two lanes with a bend."""

    @classmethod
    def default_config(cls):
        return {
            **super().default_config(),
            "simulation_frequency": 10,
            "policy_frequency": 5,
        }

    def _reset(self):
        network, right = RoadNetwork(), np.radians(90)
        for aside in (0, 4):  # m; y points down
            network.add_lane(
                "a", "b", StraightLane([0, aside], [110, aside], speed_limit=12)
            )
            network.add_lane(
                "b", "c", CircularLane([110, 40], 40 - aside, -right, 0, speed_limit=9)
            )
            network.add_lane(
                "c",
                "d",
                StraightLane([150 - aside, 40], [150 - aside, 240], speed_limit=12),
            )
        self.road = Road(network, np_random=self.np_random)
        for k in range(12):
            place, speed = (
                9 * k + self.np_random.uniform(0, 3),
                self.np_random.uniform(5, 10),
            )
            vehicle = IDMVehicle.make_on_lane(
                self.road, ("a", "b", k % 2), place, speed
            )
            vehicle.LENGTH, vehicle.WIDTH = (
                (8.0, 2.5) if self.np_random.uniform() < 0.2 else (4.6, 1.8)
            )
            vehicle.target_speed = self.np_random.uniform(8, 13)
            vehicle.randomize_behavior()
            self.road.vehicles.append(vehicle)
        self.controlled_vehicles = [self.road.vehicles[4]]  # carries the sensor

    def _reward(self, action):
        return 0.0

    def _is_terminated(self):
        return False

    def _is_truncated(self):
        return False


if "Bend-v0" not in gymnasium.registry:
    gymnasium.register("Bend-v0", entry_point="own_highway_env:BendEnv")
# --8<-- [end:environment]
# --8<-- [start:run]
if __name__ == "__main__":
    shipped = load_card("MTP-Roundabout-v0").stored()  # 2 Hz, detector, task and sizes
    seeds = {"train": [0, 20], "val": [100, 104], "test": [200, 204]}
    source = {
        "name": "gym",
        "id": "own_highway_env:Bend-v0",
        "policy": "idm",
        "seconds": 20.0,
        "seeds": seeds,
    }
    own = {
        "id": "MTP-Bend-v0",
        "summary": "a road with a bend",
        "source": source,
        "lanes": True,
    }
    card = parse_card({**shipped, **own})
    mtp_bench.run("stp", card, "runs/bend", replace=True)
    print(mtp_bench.score("runs/bend").report)
# --8<-- [end:run]
