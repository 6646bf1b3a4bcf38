"""Other feeds and the wire contract: what a sender or a file holds becomes BSM v1."""
