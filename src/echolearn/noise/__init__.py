"""Noises at the microphones: several implementations of `echolearn.types.Noise`, one module each."""
