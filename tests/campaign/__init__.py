"""Faults on purpose: kills, damaged files, mutated input, threads. `python tests/campaign` runs them at length."""
