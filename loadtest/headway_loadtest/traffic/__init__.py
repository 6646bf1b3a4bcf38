"""Messages made from drives, and sent on time."""
