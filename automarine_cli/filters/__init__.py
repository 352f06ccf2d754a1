"""States of runs given their readings: extended Kalman filters with a disturbance that is a process."""
