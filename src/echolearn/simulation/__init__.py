"""From a room, a pose and noises to what a robot hears."""
