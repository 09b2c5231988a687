"""Engines for responses: one module each, of one interface (`acoustics.types.Responder`)."""
