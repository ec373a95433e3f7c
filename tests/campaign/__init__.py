"""Faults on purpose: kills, damaged files, mutated input, threads. `python tests/campaign --help` runs them at length."""
