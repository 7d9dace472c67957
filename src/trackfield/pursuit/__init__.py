"""From tracks to pursuers that capture: steering in least time, and who chases whom."""
