"""Messages from and to the bus."""
