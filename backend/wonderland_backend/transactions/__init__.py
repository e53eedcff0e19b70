"""Changes of the registry, each signed by the person who makes it: the backend proposes and passes on, never signs."""
