"""Recorded walks: their folder format, read and checked."""
