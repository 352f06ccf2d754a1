"""What plays a run: one kind of vehicle, one file."""
