"""Events and their evidence: onset, update, cleared."""
