"""From measurements to a material with error bars."""
