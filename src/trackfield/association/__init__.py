"""Which report belongs to which target: trackers of many unknown targets."""
