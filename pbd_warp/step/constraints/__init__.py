"""Constraints of a model, bound to a device: each has `begin(stage)`, run once a stage, and `project(stage, u, valence,
relaxation, residual, correction)`, run by a method in every sweep."""
