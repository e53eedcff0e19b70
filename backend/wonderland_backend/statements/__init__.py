"""Answers that this server signs, for whoever asks for `application/jose`."""
