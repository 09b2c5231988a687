"""Engines for room impulse responses: one module each, one interface (`acoustics.types.Responder`)."""
