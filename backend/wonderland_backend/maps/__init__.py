"""Base maps that lie on this server: a PMTiles archive, aerial images; described to the console, served by ranges."""
