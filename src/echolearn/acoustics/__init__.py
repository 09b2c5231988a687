"""Nouns, geometry and signals: numpy and scipy alone."""
