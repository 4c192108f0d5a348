"""The routes: each parses, calls the use case and answers."""
