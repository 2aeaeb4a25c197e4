"""Experiments: physics in, tidy tables out."""
