"""The models on real leader and follower pairs."""
