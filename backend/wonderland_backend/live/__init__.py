"""What browsers see at once: one encoded frame per tick for all of them, resumable, never unbounded."""
