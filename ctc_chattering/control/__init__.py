"""The laws of the paper as a sampled controller."""
