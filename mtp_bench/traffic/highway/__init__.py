"""Traffic simulated on highway-env's roads, one scene per seed."""

from .source import DATASET, HighwayTraffic, package

PACKAGE = package(HighwayTraffic, DATASET)
