"""A map that grows while the robot records: followed, shown, and made whole at the end."""
