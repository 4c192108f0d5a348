"""Estimates of plans beside the processor time of what they plan."""
