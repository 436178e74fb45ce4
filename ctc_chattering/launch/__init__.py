"""Processes of a running graph."""
