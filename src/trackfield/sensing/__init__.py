"""What one sensor says: expected reading, slope, noise, simulation, calibration; by kind."""
