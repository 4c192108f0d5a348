"""Run time and error of every method."""
