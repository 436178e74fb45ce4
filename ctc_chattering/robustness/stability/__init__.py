"""Stability of a sampled loop: what errors of model, lag and delay it stands, computed."""
