"""Labelled sets of observations."""
