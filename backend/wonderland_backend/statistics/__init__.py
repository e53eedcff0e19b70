"""What the verdicts of a span of time come to: counts, distributions, and how long each step took."""
