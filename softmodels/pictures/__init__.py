"""Pictures, films and pages of runs and fits."""
