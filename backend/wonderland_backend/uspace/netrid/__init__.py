"""Network Remote ID (ASTM F3411-22a): service provider, display provider, and the test interfaces of InterUSS."""
