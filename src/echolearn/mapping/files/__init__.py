"""The files of a map, one module for each format."""
