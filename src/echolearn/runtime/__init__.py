"""Processes, engines, progress, timing."""
