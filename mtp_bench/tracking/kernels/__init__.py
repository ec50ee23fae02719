"""Compiled kernels of the tracker, and what compiles them; importing loads none."""
