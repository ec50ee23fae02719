"""Detector model 1: score, error and miss of an object are drawn apart. Profiles of it stay readable."""
