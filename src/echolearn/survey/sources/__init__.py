"""Published measurements: one module, one source."""
