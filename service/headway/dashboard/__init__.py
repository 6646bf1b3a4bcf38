"""What people see of the detector: a web page and a terminal view, subscribers of the bus like any other."""
