"""All photographs of a list: pressures, photographs, and what they tell of each other."""
