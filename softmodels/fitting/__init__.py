"""From measurements to a material with error bars.

- `problem`: parameters, priors, sources of residuals. `least_squares`: the fit, intervals, identifiability, profiles.
- `comparison`: laws compared and judged; their report as text and files.
- `scoring`: a law against measurements it was not fitted to.
- `curves`, `outlines`: the two kinds of measurements. `leak`: a leak from pressures that fall.
- `vibration`: the ringing of a device, for its silicone's memory.
"""
