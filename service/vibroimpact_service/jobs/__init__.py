"""Durable jobs: SQL records, leases and the engine that runs their chunks."""
