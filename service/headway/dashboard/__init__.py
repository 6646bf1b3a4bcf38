"""A web page and a terminal view, which subscribe to the bus like any other client."""
