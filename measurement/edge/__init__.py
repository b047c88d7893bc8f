"""The shadow and its edge in raw pixels, with what lies across it."""
