"""Compiled kernels of the tracker and what compiles them; importing this loads nothing."""
