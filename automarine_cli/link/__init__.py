"""The vehicle's side and the surface's side of a campaign that drives itself: documents, logs, a server, a player."""
