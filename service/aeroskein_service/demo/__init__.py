"""What the demo plays: one configuration with simulated traffic, one with recorded traffic."""
