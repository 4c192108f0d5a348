"""The computation service: HTTP in front, a durable job queue behind."""
