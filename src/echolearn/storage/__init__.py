"""A file is whole, a folder finished, a thing made once."""
