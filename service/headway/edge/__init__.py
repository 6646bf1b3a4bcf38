"""The shell around the core: bytes, sockets, clocks and files live here and nowhere else."""
