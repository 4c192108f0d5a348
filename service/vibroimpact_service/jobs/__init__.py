"""Durable jobs: SQL records, leases, and the engine that computes their chunks."""
