"""Values that pass between the layers."""
