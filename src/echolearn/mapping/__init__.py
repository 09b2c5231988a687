"""From echoes to map points, walls and map files."""
