"""Identity, odometer, path history and leader of each vehicle."""
