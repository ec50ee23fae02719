"""What detections show of known objects: matches, errors, and how they hang together."""
