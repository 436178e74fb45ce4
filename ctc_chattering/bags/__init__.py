"""Recorded runs: read, write, repair, replay."""
