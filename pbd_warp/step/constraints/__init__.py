"""Constraints: what is held (a frozen set) and how it is projected (bound to one simulation).

A set has `valence(count)`, `residual(x)` and `bind(sim)`; what `bind` returns has `begin()`, run once a substep,
and `project(u, share, relaxation, residual, correction)`, run by a method in every sweep.
"""
