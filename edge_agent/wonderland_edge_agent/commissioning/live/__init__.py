"""Commissioning at a live pad, step by step; each step's result is kept, so that it goes on after an interruption."""
