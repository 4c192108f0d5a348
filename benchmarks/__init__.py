"""Benchmarks: run time against error, speed against peers, scaling, and what plans skip."""
