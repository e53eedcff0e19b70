"""The discovery and synchronisation service of U-space: who serves, and who wants to know, where."""
