"""A run with truth to calibrated models; a file a kind of sensor."""
