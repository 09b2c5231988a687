"""The files of a map, one module for each format: `write(walk) -> {file name: content}`."""
