"""Durable jobs: records in SQL, claims, and the engine that computes their chunks."""
