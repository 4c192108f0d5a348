"""Checks of an installation: each tells what it saw, and what to do about it."""
