"""People: who may sign in and as what, their passkeys and sign-ins, invitations and recovery."""
