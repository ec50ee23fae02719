"""Closed loop: forecasts of an agent drive the ego of simulated traffic."""
