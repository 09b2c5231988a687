"""Estimators of echoes: several implementations of `echolearn.types.Localizer`, one module each.

A localizer is a frozen dataclass called with an `Observation` (samples (..., M, N)) and returning `Echoes`
((..., R)). `beam.py` holds the functions they share: steering, covariances, steered responses.
"""
