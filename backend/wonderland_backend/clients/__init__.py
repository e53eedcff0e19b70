"""Machines as clients: OAuth 2.0 client credentials, scopes, what each may read, how often, and how once."""
