"""What replays read: a moment of the past, what happened after it, marks on the time line, a session."""
