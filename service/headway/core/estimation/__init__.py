"""Motion models of one vehicle: what its own sensors say of each other."""
