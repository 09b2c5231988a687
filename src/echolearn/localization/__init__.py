"""From recordings to echoes and the columns that describe them."""
