"""Walls from a whole walk: evidence summed over its poses, hypotheses, strips, tracks."""
