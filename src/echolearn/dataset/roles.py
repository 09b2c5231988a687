"""What a set is for."""

ROLES = ("training", "grid", "test")
"""`training` classifiers that are to be used; `grid`, positions on a grid as in the paper, where
few distances from the walls can be memorised; `test` alone, never training."""
