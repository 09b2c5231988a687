"""From what is known about an echo to the belief that a wall made it."""
