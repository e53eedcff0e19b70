"""What the registry reads: records with their past, organisations, certificates."""
