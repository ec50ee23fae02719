"""Synthetic traffic: highway-env roads and vehicles with populations, rules and pedestrians of our own."""
