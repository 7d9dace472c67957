"""Who senses next: geometry, selection, activation, lifetime, and the robot that follows."""
