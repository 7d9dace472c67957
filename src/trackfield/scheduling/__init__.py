"""Who senses next: geometry, selection, activation, lifetime, the closed loop."""
