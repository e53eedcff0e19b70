"""The registry as people keep it: records with their versions and history, organisations, certificates, imports."""
