"""Engines, where many independent jobs are done: one module each, one interface
(`runtime.engine.Engine`).
"""
