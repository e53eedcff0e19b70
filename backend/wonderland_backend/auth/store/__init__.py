"""What is kept of signing in: sign-ins, links, passkeys, and what browsers were asked."""
