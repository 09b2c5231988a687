"""Engines for responses: one module each, of one interface (`simulation.scene.Responder`)."""
