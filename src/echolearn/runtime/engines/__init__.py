"""Implementations of `runtime.engine.Engine`, one module each, and nothing else."""
