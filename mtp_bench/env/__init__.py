"""The Gymnasium environment `MTPEnv`, its spaces, and the table of the action's fields."""
