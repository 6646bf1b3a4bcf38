"""What the commands do. A command imports it when it runs, so that the command line itself starts at once."""
