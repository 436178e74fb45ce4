"""Soak test: random faults on the whole graph in real time; ``make soak`` runs it."""
