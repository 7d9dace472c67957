"""From the readings of one scan to a position: reports, starts, bounds."""
