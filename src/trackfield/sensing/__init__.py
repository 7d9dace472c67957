"""What one sensor says: expected reading, Jacobian, noise, simulation, calibration. One file a kind."""
