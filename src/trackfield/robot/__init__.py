"""A robot that follows a target: the least move, looking ahead, cars, obstacles, its sink."""
