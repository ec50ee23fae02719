"""Detector model 2: one lasting quality per object and frame behind score, error, miss; false positives that live."""
