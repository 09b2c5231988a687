"""How well localizers find echoes while one thing is varied."""
