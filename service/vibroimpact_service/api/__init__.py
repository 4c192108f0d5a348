"""The routes: each reads a request, calls the use case and answers."""
