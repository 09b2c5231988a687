"""Noises at the microphones: several implementations of `echolearn.acoustics.types.Noise`, one
module each.
"""
