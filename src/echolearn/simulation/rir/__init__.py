"""Engines for responses: one module each, of one interface (`acoustics.rooms.Responder`)."""
