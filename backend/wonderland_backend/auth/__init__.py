"""Who may look: one-time tokens and server-side sign-ins for people, ledger identities for agents."""
