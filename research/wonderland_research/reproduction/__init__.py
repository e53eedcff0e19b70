"""What can be repeated: the paper's experiment, real recordings, and the goals of the verdict with their figures."""
