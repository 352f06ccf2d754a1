"""Tables and figures: the only room with matplotlib."""
