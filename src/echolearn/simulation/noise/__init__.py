"""Noises at the microphones: one module each, of one interface (`acoustics.types.Noise`)."""
