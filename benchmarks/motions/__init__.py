"""Motions with impacts that several integrators follow: cases, references, and the integrators."""
