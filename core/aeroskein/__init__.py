"""aeroskein core."""
