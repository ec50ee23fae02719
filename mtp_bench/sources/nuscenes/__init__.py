"""nuScenes: the official v1.0 tables and detection files, read into a compact cache."""
